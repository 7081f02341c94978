"""The golden recordings give the same decisions on another Python, without the simulation: `make test-other-python`."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
GOLDEN = sorted((ROOT / "tests" / "golden").glob("*.mcap"))


def main(python: str) -> None:
    version = _version(python)
    if not version:
        say(f"NOT CHECKED: there is no {python}; name another one with OTHER=...")
        return
    with tempfile.TemporaryDirectory() as folder:
        run(python, "-m", "venv", folder)
        run(f"{folder}/bin/python", "-m", "pip", "install", "--quiet", str(ROOT))
        for recording in GOLDEN:
            replayed = run(f"{folder}/bin/viewsep", "replay", str(recording), "--verify", "--json", cwd=folder)
            found = json.loads(replayed)
            decisions = found["decisions"]
            kind = "byte for byte" if decisions["exact"] else "with floats within the tolerance"
            repeated = f"{decisions['outputs']} outputs of {decisions['events']} events {kind}"
            say(f"Python {version}: {recording.name}, {repeated}")


def _version(python: str) -> str:
    """Its version, empty where it does not run."""
    try:
        return run(python, "-c", "import platform; print(platform.python_version())").strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def run(*command: str, cwd: str | None = None) -> str:
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=cwd).stdout


def say(line: str) -> None:
    sys.stdout.write(line + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1])
