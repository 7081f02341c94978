"""Objects cut out of photos taken against a plain background."""

from __future__ import annotations

import cv2
import numpy as np

from viewsep.errors import BadInput
from viewsep.messages import Array, BoolArray

BORDER_SHARE = 0.02  # of the shorter side: how wide the border is that shows the background
PLAIN_SHARE = 0.6  # of the border that must have the background's colour; the object may touch it here and there
TOLERANCE = (14.0, 40.0)  # grey levels, as a distance in RGB: least and most
NOISE_MULTIPLE = 6.0  # of the border's median distance from its median colour
SPECK_SHARE = 0.05  # of the largest piece: smaller ones are dust or shadow
SMALLEST_SHARE, LARGEST_SHARE = 0.002, 0.98  # of the picture


def segment(image: Array, name: str) -> BoolArray:
    """(H, W) mask of what differs from the colour of the border of an (H, W, 3) uint8 picture, holes filled.

    Raises BadInput, naming the picture, when the border is not plain, or nothing or everything is left.
    """
    colour, tolerance = _background(image, name)
    differs = np.linalg.norm(image.astype(np.float32) - colour, axis=2) > tolerance
    pieces = cv2.morphologyEx(differs.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3)))
    outlines, _ = cv2.findContours(pieces, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    areas = [cv2.contourArea(outline) for outline in outlines]
    kept = [outline for outline, area in zip(outlines, areas, strict=True) if area >= SPECK_SHARE * max(areas)]
    mask = np.zeros(image.shape[:2], np.uint8)
    cv2.drawContours(mask, kept, -1, 1, cv2.FILLED)
    share = float(mask.mean())
    if share < SMALLEST_SHARE:
        raise BadInput(f"{name}: nothing stands out from the background; use another background, or give a mask")
    if share > LARGEST_SHARE:
        raise BadInput(f"{name}: no background is left around the object; take it from further away, or give a mask")
    return np.asarray(mask > 0)


def _background(image: Array, name: str) -> tuple[Array, float]:
    """(3,) float32 median colour of the border and how far from it is background still. Raises BadInput."""
    width = max(1, round(BORDER_SHARE * min(image.shape[:2])))
    inner = np.zeros(image.shape[:2], bool)
    inner[width:-width, width:-width] = True
    border = image[~inner].astype(np.float32)
    colour: Array = np.median(border, axis=0)
    away = np.linalg.norm(border - colour, axis=1)
    tolerance = float(np.clip(NOISE_MULTIPLE * np.median(away), *TOLERANCE))
    plain = float((away <= tolerance).mean())
    if plain < PLAIN_SHARE:
        raise BadInput(
            f"{name}: only {plain:.0%} of the picture's border has one colour (needed: {PLAIN_SHARE:.0%}); take the "
            "photo against a plain background, or give a mask"
        )
    return colour, tolerance
