"""From a camera's picture to the square one that descriptors get: as large as renders of the object are."""

from __future__ import annotations

import cv2
import numpy as np

from viewsep.errors import BadInput
from viewsep.framing import FRAME_FILL
from viewsep.messages import Array, BoolArray


def enclosing_circle(mask: BoolArray) -> tuple[float, float, float]:
    """Middle (x, y) and radius in pixels of the smallest circle around an (H, W) mask. Raises BadInput when empty."""
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    if not outlines:
        raise BadInput("there is no object in the mask to cut out")
    (x, y), radius = cv2.minEnclosingCircle(cv2.convexHull(np.concatenate(outlines)))
    return float(x), float(y), max(float(radius) + 0.5, 1.0)


def squared(
    image: Array, mask: BoolArray, middle: tuple[float, float], radius_px: float, size_px: int
) -> tuple[Array, BoolArray]:
    """The square around `middle` (x, y) in which a sphere of `radius_px` is as large as in renders: `size_px` wide.

    Picture (size, size, 3) uint8 and mask (size, size) bool; beyond the picture's border its edge is repeated.
    """
    side = max(2, round(2.0 * radius_px / FRAME_FILL))
    whole = max(1, side // size_px)  # by a whole number first: many times faster
    side = max(whole, round(side / whole) * whole)
    left, top = round(middle[0] + 0.5 - side / 2), round(middle[1] + 0.5 - side / 2)
    height, width = mask.shape
    inside = np.s_[max(0, top) : max(0, min(height, top + side)), max(0, left) : max(0, min(width, left + side))]
    margins = (max(0, -top), max(0, top + side - height), max(0, -left), max(0, left + side - width))
    part: Array = image[inside]
    on: Array = mask[inside].view(np.uint8) * np.uint8(255)
    if any(margins):
        part = cv2.copyMakeBorder(part, *margins, cv2.BORDER_REPLICATE)
        on = cv2.copyMakeBorder(on, *margins, cv2.BORDER_CONSTANT, value=0)
    small, soft = (_reduced(each, side // whole, size_px) for each in (part, on))
    return small, np.asarray(soft >= 128)


def _reduced(picture: Array, first_px: int, size_px: int) -> Array:
    """A square picture as (size_px, size_px), by way of a size that its own is a multiple of."""
    if first_px < len(picture):
        picture = cv2.resize(picture, (first_px, first_px), interpolation=cv2.INTER_AREA)
    how = cv2.INTER_AREA if first_px >= size_px else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(picture, (size_px, size_px), interpolation=how))
