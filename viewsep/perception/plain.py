"""The ground as one colour that may get brighter to one side, read off the picture itself."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from viewsep.messages import Array, FloatArray
from viewsep.perception.boxes import Box
from viewsep.perception.ground import Difference
from viewsep.perception.shadow import soft_shadow

BORDER_SHARE = 0.04  # of the shorter side: how wide the border is that shows the backdrop
PLAIN_SHARE = 0.6  # of the border that must be backdrop; holder and object may cross it
TOLERANCE = (9.0, 30.0)  # grey levels: least and most
NOISE_MULTIPLE = 6.0  # of the border's median distance from the fit
ROUNDS = 3


@dataclass(frozen=True, slots=True)
class PlainBackdrop:
    """`Ground` of one colour; nothing is learned. A holder that is seen must be given as a `Holder`."""

    shows_holder: bool = False

    def difference(self, image: Array, joints: Sequence[float], box: Box) -> Difference:
        """Where a picture differs from the colour of its border, soft shadows left out."""
        plane, tolerance, plain = _backdrop(image)
        problem = ""
        if plain < PLAIN_SHARE:
            problem = (
                f"only {plain:.0%} of the picture's border has one colour (needed: {PLAIN_SHARE:.0%}): use a plain "
                "backdrop, or a captured background"
            )
        ground = _drawn(plane, box)
        smooth = cv2.blur(image[box.part], (3, 3))
        away = cv2.absdiff(smooth, ground)
        same: Array = cv2.inRange(away, np.zeros(3), np.full(3, tolerance))
        middle = np.array([image.shape[1] / 2, image.shape[0] / 2, 1.0]) @ plane
        shadow = soft_shadow(smooth, ground)
        return Difference((~same >> 7) & ~shadow, shadow, problem, middle)


def _backdrop(image: Array) -> tuple[FloatArray, float, float]:
    """The backdrop's (3, 3) plane: each channel from (x, y, 1), its tolerance, and the share of the border it fits."""
    height, width = image.shape[:2]
    deep = max(2, round(BORDER_SHARE * min(height, width)))
    step = max(1, min(height, width) // 120)
    rows, columns = np.arange(0, height, step), np.arange(0, width, step)
    y, x = (g.ravel() for g in np.meshgrid(rows, columns, indexing="ij"))
    edge = (x < deep) | (y < deep) | (x >= width - deep) | (y >= height - deep)
    x, y = x[edge], y[edge]
    seen = image[y, x].astype(np.float64)
    places = np.stack([x, y, np.ones_like(x)], axis=1).astype(np.float64)
    fitted = np.broadcast_to(np.median(seen, axis=0), seen.shape)
    plane = np.zeros((3, 3))
    for _ in range(ROUNDS):
        off = np.abs(seen - fitted).max(axis=1)
        keep = off <= np.clip(NOISE_MULTIPLE * np.median(off), *TOLERANCE)
        plane = np.linalg.lstsq(places[keep], seen[keep], rcond=None)[0]
        fitted = places @ plane
    off = np.abs(seen - fitted).max(axis=1)
    tolerance = float(np.clip(NOISE_MULTIPLE * np.median(off) / 3.0, *TOLERANCE))  # the smoothed picture has less noise
    return plane, tolerance, float((off <= np.clip(NOISE_MULTIPLE * np.median(off), *TOLERANCE)).mean())


def _drawn(plane: FloatArray, box: Box) -> Array:
    """The plane in the box, (h, w, 3) uint8."""
    x, y = np.arange(box.left, box.right, dtype=np.float32), np.arange(box.top, box.bottom, dtype=np.float32)
    slope_x, slope_y, level = plane.astype(np.float32)
    across = x[:, None] * slope_x + level
    ground = across[None] + (y[:, None] * slope_y)[:, None]
    drawn: Array = np.clip(ground + 0.5, 0, 255).astype(np.uint8)
    return drawn
