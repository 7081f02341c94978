"""The command line. Mistakes of the user end in one sentence and exit code 2, never in a traceback."""

from __future__ import annotations

import sys

from viewsep.errors import ViewsepError


def main() -> None:
    """Entry point of the `viewsep` command."""
    try:
        from viewsep.cli.app import app  # imported here so that Ctrl-C meanwhile ends as it does later

        app(prog_name="viewsep")
    except ViewsepError as error:
        print(f"viewsep: {error}", file=sys.stderr)  # noqa: T201
        raise SystemExit(error.exit_code) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
