"""Builds the wheel, installs it into a clean environment and uses it from another folder; `make wheel` runs this."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path

ROOT = Path(__file__).parents[1]
FILES = (
    "py.typed",
    "recordings/layouts/viewsep.json",
    "recordings/schemas/viewsep.proto",
    "recordings/schemas/viewsep_pb2.pyi",
)
PYTHON = sys.version_info

IMPORT_ALL = """
import importlib, pkgutil, sys, viewsep
failed, count = [], 0
names = [m.name for m in pkgutil.walk_packages(viewsep.__path__, "viewsep.", onerror=failed.append)]
for name in names:
    if name == "viewsep.__main__":
        continue
    try:
        importlib.import_module(name)
        count += 1
    except Exception as error:
        failed.append(f"{name}: {type(error).__name__}: {error}")
print(viewsep.__file__, count, *sorted(n for n in names if "." not in n.removeprefix("viewsep.")))
sys.exit("\\n".join(failed) or 0)
"""
FOLDERS = ("drivers", "recordings", "sim")


class Broken(Exception):
    """Something about the wheel is not as it should be; the text says what."""


def run(*command: str | Path, folder: Path, fails: bool = False) -> str:
    """Output of a command that must end well, or badly where it `fails`; no path of this checkout leaks in."""
    clean = {key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV")}
    ended = subprocess.run([str(part) for part in command], cwd=folder, env=clean, capture_output=True, text=True)
    if (ended.returncode != 0) != fails:
        end = "ended well, but should not" if fails else f"ended with code {ended.returncode}"
        raise Broken(f"{' '.join(map(str, command[:6]))} {end}:\n{ended.stdout}{ended.stderr}")
    return ended.stdout + ended.stderr if fails else ended.stdout


def build(folder: Path) -> Path:
    """The wheel, built from what is in the checkout."""
    run(sys.executable, "-m", "build", "--wheel", "--outdir", folder / "dist", ROOT, folder=folder)
    wheels = list((folder / "dist").glob("viewsep-*.whl"))
    if len(wheels) != 1:
        raise Broken(f"the build made {len(wheels)} wheels instead of one")
    return wheels[0]


def check(folder: Path) -> str:
    """Build, install and use the wheel inside `folder`; a line about it."""
    wheel = build(folder)
    venv.create(folder / "env", with_pip=True)
    python, elsewhere = folder / "env" / "bin" / "python", folder / "elsewhere"
    elsewhere.mkdir()
    run(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", wheel, folder=elsewhere)

    where, count, *found = run(python, "-c", IMPORT_ALL, folder=elsewhere).split()
    package = Path(where).parent
    if not package.is_relative_to(folder / "env"):
        raise Broken(f"viewsep was imported from {package}, not from the clean environment")
    sources = list((ROOT / "viewsep").rglob("*.py"))
    sources += [path for name in FOLDERS for path in (ROOT / name).rglob("*.py")]
    expected = {
        path.relative_to(ROOT / "viewsep" if path.is_relative_to(ROOT / "viewsep") else ROOT) for path in sources
    }
    missing = [str(path) for path in sorted(expected) if not (package / path).is_file()]
    missing += [name for name in FILES if not (package / name).is_file()]
    if missing:
        raise Broken(f"the wheel lacks {', '.join(missing)}: see [tool.setuptools] in pyproject.toml")
    for name in FOLDERS:
        if name not in {part.removeprefix("viewsep.") for part in found}:
            raise Broken(f"viewsep.{name} is not among the installed packages: {' '.join(found)}")
        said = run(python, "-c", f"import {name}", folder=elsewhere, fails=True)
        if "No module named" not in said:
            raise Broken(f"`import {name}` finds something of that general name: {said}")

    command = folder / "env" / "bin" / "viewsep"
    version = run(command, "--version", folder=elsewhere).strip()
    if version.split() != ["viewsep", wheel.name.split("-")[1]]:
        raise Broken(f"`viewsep --version` prints {version!r}, the wheel is {wheel.name}")
    made = ""
    if PYTHON < (3, 12):  # pybullet has wheels for 3.11 only
        run(command, "learn", "generated:3", "-o", "lib", "--views", "12", folder=elsewhere)
        if not (elsewhere / "lib" / "product_3.viewsep").is_file():
            raise Broken("`viewsep learn generated:3 -o lib` ended well, but there is no lib/product_3.viewsep")
        made = ", an object learned"
    return f"{wheel.name}: {count} modules imported, {len(expected)} files, {version}{made}"


def main() -> None:
    """Print one line; exit with 1 and the reason when something is wrong."""
    begin = time.monotonic()
    try:
        with tempfile.TemporaryDirectory(prefix="viewsep-wheel-") as folder:
            line = check(Path(folder).resolve())
    except Broken as error:
        sys.exit(f"wheel: {error}")
    sys.stdout.write(f"wheel: {line}, {time.monotonic() - begin:.0f} s\n")


if __name__ == "__main__":
    main()
