"""Colour co-occurrence histogram (section III): 320 numbers = 16² colour pairs + 8² gradient pairs."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from viewsep.errors import BadInput
from viewsep.messages import Array, FloatArray

COLOURS = 16  # red and green, 4 levels each
GRADIENTS = 8  # gradient magnitude of red (4 levels) and green (2 levels)
CODES = COLOURS * GRADIENTS
DIRECTIONS = 8


@dataclass(frozen=True)
class ColourCooccurrence:
    """The seed's descriptor: which colours and edge strengths lie `distance_px` apart, in all directions.

    Red and green are jointly quantised 4 x 4, their gradient magnitudes 4 x 2. Pairs count when both pixels and their
    3 x 3 neighbourhoods are on the object. The histogram is symmetric and each block sums to one half, so the
    histogram intersection of a view with itself is 1. Roll-invariant up to the sampling of eight directions.
    """

    distance_px: Annotated[int, Field(ge=1, le=31)] = 4
    gradient_step: Annotated[int, Field(ge=1, le=255)] = 6

    @property
    def name(self) -> str:
        """Registered name."""
        return "cch"

    @property
    def parameters(self) -> dict[str, float | int | str]:
        """What the features depend on."""
        return {"distance_px": self.distance_px, "gradient_step": self.gradient_step}

    @property
    def size(self) -> int:
        """320."""
        return COLOURS**2 + GRADIENTS**2

    def describe(self, image: Array, mask: Array | None) -> Array:
        """(H, W, 3) uint8 RGB and (H, W) bool -> (320,) float32. Raises BadInput when the mask leaves no pixel pair."""
        codes = self._codes(image, mask)
        pairs = np.zeros((CODES, CODES), np.float32)
        height, width = codes.shape
        for dy, dx in self._offsets():
            a = codes[max(0, -dy) : height - max(0, dy), max(0, -dx) : width - max(0, dx)]
            b = codes[max(0, dy) : height + min(0, dy), max(0, dx) : width + min(0, dx)]
            # codes of CODES and above are off the object and fall outside the ranges
            pairs += cv2.calcHist([a, b], [0, 1], None, [CODES, CODES], [0, CODES, 0, CODES])
        total = float(pairs.sum())
        if total == 0.0:
            raise BadInput(
                f"the object covers too little of the picture: no two pixels of it are {self.distance_px} px apart"
            )
        blocks = pairs.reshape(COLOURS, GRADIENTS, COLOURS, GRADIENTS)
        colour = blocks.sum(axis=(1, 3))
        gradient = blocks.sum(axis=(0, 2))
        feature = np.concatenate([(colour + colour.T).ravel(), (gradient + gradient.T).ravel()])
        return (feature / (4.0 * total)).astype(np.float32)

    def similarity(self, feature: Array, features: Array) -> FloatArray:
        """Histogram intersection (the seed's w0): (320,) against (N, 320) -> (N,) float64 in [0, 1]."""
        intersection: FloatArray = np.minimum(feature, features).sum(axis=1, dtype=np.float64)
        return intersection

    def _codes(self, image: Array, mask: Array | None) -> Array:
        """(H, W) uint8 joint colour and gradient class; 255 off the object."""
        red_green = np.ascontiguousarray(image[..., :2])
        dx = cv2.Sobel(red_green, cv2.CV_32F, 1, 0, scale=0.125)
        dy = cv2.Sobel(red_green, cv2.CV_32F, 0, 1, scale=0.125)
        level = (np.sqrt(dx * dx + dy * dy) / self.gradient_step).astype(np.uint8)
        quantised = red_green >> 6
        codes = (quantised[..., 0] * 4 + quantised[..., 1]) * GRADIENTS
        codes += np.minimum(level[..., 0], 3) * 2 + np.minimum(level[..., 1], 1)
        if mask is not None:
            # the 3 x 3 neighbourhood too, so that the background never enters a gradient
            inside = cv2.erode(mask.view(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_REPLICATE)
            codes[inside == 0] = 255
        return codes

    def _offsets(self) -> list[tuple[int, int]]:
        """Half a circle of (dy, dx) pixel offsets; the other half follows by symmetry."""
        angles = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
        return [(round(self.distance_px * np.sin(a)), round(self.distance_px * np.cos(a))) for a in angles]
