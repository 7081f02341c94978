"""From the configuration to the settings of a real camera."""

from __future__ import annotations

from viewsep.camera_config import V4l2Config
from viewsep.drivers.v4l2.settings import V4l2Settings
from viewsep.errors import BadConfig


def v4l2_settings(given: V4l2Config, origin: str) -> V4l2Settings:
    """What `[v4l2]` says. Raises BadConfig naming `origin` for what no camera can do."""
    settings = V4l2Settings(
        device=given.device,
        format=given.format,
        width=given.width_px,
        height=given.height_px,
        rate_hz=given.rate_hz,
        exposure_ms=given.exposure_ms,
        white_balance_k=given.white_balance_k,
        gain=given.gain,
        focus=given.focus,
        stamps=given.stamps,
        stall_s=given.stall_s,
    )
    try:
        settings.check()
    except BadConfig as error:
        raise BadConfig(f"{origin}: section [v4l2]: {error}") from error
    return settings
