"""From the bytes of a camera to a picture.

OpenCV could decode them, but makes a picture whose rest is wrong of one that lost its middle on the way, prints
"Corrupt JPEG data" and reports no error. simplejpeg is the same decoder (libjpeg-turbo), and raises
its complaints.
"""

from __future__ import annotations

import re
from typing import Any

import cv2
import numpy as np
import simplejpeg

from viewsep.drivers.v4l2.settings import V4l2Settings
from viewsep.messages import Array

FIRST, LAST = b"\xff\xd8", b"\xff\xd9"  # markers of a JPEG
PADDING = 65536  # zeros that may follow the end
EXTRANEOUS = re.compile(r"(\d+) extraneous bytes before marker")
HARMLESS_BYTES = 64  # that many too many some webcams send with every picture


class Damaged(Exception):
    """The bytes are no whole picture; the text says why."""


def whole(raw: Any, settings: V4l2Settings) -> Array:
    """The bytes as OpenCV gives them unconverted, checked for what is quickly seen. Raises Damaged."""
    if not isinstance(raw, np.ndarray) or raw.dtype != np.uint8:
        raise Damaged("no bytes came")
    if settings.format == "YUYV":
        if raw.shape != (settings.height, settings.width, 2):
            raise Damaged(f"it has the shape {raw.shape}")
    elif raw.reshape(-1)[:2].tobytes() != FIRST:
        raise Damaged("it does not begin as a JPEG")
    elif not raw.reshape(-1)[-PADDING:].tobytes().rstrip(b"\0").endswith(LAST):
        raise Damaged("its end is missing")
    return raw


def decoded(raw: Array, settings: V4l2Settings) -> Array:
    """(H, W, 3) uint8 RGB. Raises Damaged."""
    image = cv2.cvtColor(raw, cv2.COLOR_YUV2RGB_YUYV) if settings.format == "YUYV" else _decoded_jpeg(raw.tobytes())
    if image.shape != (settings.height, settings.width, 3):
        raise Damaged(f"it is {image.shape[1]} x {image.shape[0]} instead of {settings.width} x {settings.height}")
    return image


def sharpness(image: Array) -> float:
    """Variance of the Laplacian of an (H, W, 3) picture: the higher, the sharper; compare only the same scene."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    return float(cv2.Laplacian(grey, cv2.CV_64F).var())


def _decoded_jpeg(data: bytes) -> Array:
    try:
        image: Array = simplejpeg.decode_jpeg(data, "RGB", strict=True)
    except ValueError as error:
        found = EXTRANEOUS.search(str(error))
        if found is None or int(found[1]) > HARMLESS_BYTES:
            raise Damaged(str(error)) from error
        image = simplejpeg.decode_jpeg(data, "RGB", strict=False)
    return image
