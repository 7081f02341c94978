"""viewsep tells look-alike objects apart by turning them in front of a camera."""

from __future__ import annotations

from importlib.metadata import version

__version__ = version("viewsep")
