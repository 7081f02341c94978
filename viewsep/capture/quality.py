"""Whether a photo is good enough to learn from: sharp, neither burnt out nor black, and with a mask."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from viewsep.messages import Array, BoolArray
from viewsep.perception.exposure import Clipped, clipped

BLURRED = 0.2  # of the median sharpness of earlier photos
ENOUGH = 5  # photos that the sharpness is compared with
EDGE_PX = 2  # the object's outline is sharp against the background whatever its print is


@dataclass(frozen=True, slots=True)
class PhotoQuality:
    """`sharpness` is the variance of the Laplacian on the object, `white` and `black` shares of its pixels."""

    sharpness: float
    white: float
    black: float

    def problem(self, earlier: Sequence[float]) -> str:
        """Why the photo is not used, given the sharpness of earlier ones; empty when it is good."""
        if problem := Clipped(self.white, self.black).problem:
            return problem
        if len(earlier) >= ENOUGH and self.sharpness < BLURRED * float(np.median(earlier)):
            return "blurred: is the rig still, and the focus fixed?"
        return ""


def photo_quality(image: Array, mask: BoolArray) -> PhotoQuality:
    """Of an (H, W, 3) uint8 RGB picture with its (H, W) mask."""
    inner = cv2.erode(mask.astype(np.uint8), np.ones((2 * EDGE_PX + 1,) * 2, np.uint8)) > 0
    if not inner.any():
        inner = mask
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    sharpness = float(cv2.Laplacian(grey, cv2.CV_32F)[inner].var())
    lost = clipped(image[inner])
    return PhotoQuality(sharpness, lost.white, lost.black)
