"""What the bits of a float may depend on: processor, Python and the numerical packages."""

from __future__ import annotations

import platform
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("viewsep", "numpy", "scipy", "opencv-python-headless")


def this_build() -> dict[str, str]:
    """Names and versions; replays are byte-exact where these agree."""
    packages = {package: version(package) for package in PACKAGES}
    return {"python": platform.python_version(), "system": platform.system(), "processor": _processor(), **packages}


def _processor() -> str:
    """The processor's model where the system tells it, its architecture otherwise."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{platform.machine()} {models[0]}" if models else platform.machine()
