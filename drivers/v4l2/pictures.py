"""From the bytes of a camera to a picture."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from viewsep.drivers.v4l2 import jpeg
from viewsep.drivers.v4l2.settings import V4l2Settings
from viewsep.messages import Array


class Damaged(Exception):
    """The bytes are no whole picture; the text says why."""


def whole(raw: Any, settings: V4l2Settings) -> Array:
    """The bytes as OpenCV gives them unconverted, checked for what is quickly seen. Raises Damaged."""
    if not isinstance(raw, np.ndarray) or raw.dtype != np.uint8:
        raise Damaged("no bytes came")
    if settings.format == "MJPG":
        if problem := jpeg.fault(raw.tobytes(), settings.width, settings.height):
            raise Damaged(problem)
    elif raw.shape != (settings.height, settings.width, 2):
        raise Damaged(f"it has the shape {raw.shape}")
    return raw


def decoded(raw: Array, settings: V4l2Settings) -> Array:
    """(H, W, 3) uint8 RGB. Raises Damaged."""
    if settings.format == "YUYV":
        return cv2.cvtColor(raw, cv2.COLOR_YUV2RGB_YUYV)
    image = cv2.imdecode(raw.reshape(-1), cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION)
    if image is None or image.shape != (settings.height, settings.width, 3):
        raise Damaged("it cannot be decoded")
    return image


def sharpness(image: Array) -> float:
    """Variance of the Laplacian of an (H, W, 3) picture: the higher, the sharper; compare only the same scene."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    return float(cv2.Laplacian(grey, cv2.CV_64F).var())
