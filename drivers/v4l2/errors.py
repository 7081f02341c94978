"""What goes wrong at a camera."""

from __future__ import annotations

from viewsep.errors import RigError


class CameraError(RigError):
    """Base of the camera's errors."""


class CameraLost(CameraError):
    """The camera cannot be opened, is used by another process, was unplugged, or sends nothing usable."""


class SettingRefused(CameraError):
    """The camera does not take a setting: it has no such format or control, or it took another value."""
