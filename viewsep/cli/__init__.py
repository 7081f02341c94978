"""The command line. Mistakes of the user end in one sentence and exit code 2, never in a traceback."""

from __future__ import annotations

import os
import sys

from viewsep.errors import ViewsepError

ONE_THREAD = {"OPENBLAS_NUM_THREADS": "1"}
"""Products of small matrices: more threads make them slow beside other work, and other in the last digit."""


def main() -> None:
    """Entry point of the `viewsep` command."""
    os.environ.update(ONE_THREAD | os.environ)  # read once, when numpy is imported
    try:
        from viewsep.cli.app import app  # imported here so that Ctrl-C meanwhile ends as it does later

        app(prog_name="viewsep")
    except ViewsepError as error:
        print(f"viewsep: {error}", file=sys.stderr)  # noqa: T201
        raise SystemExit(error.exit_code) from None
    except KeyboardInterrupt:
        raise SystemExit(130) from None
