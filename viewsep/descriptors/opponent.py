"""Soft opponent co-occurrence: which lightness and hues lie next to which, robust to light, noise and blur."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
from pydantic import Field

from viewsep.descriptors.exposure import opponent_colours
from viewsep.errors import BadInput
from viewsep.messages import Array, FloatArray

HALF_TURN = 6  # directions of the pixel pairs


@dataclass(frozen=True)
class OpponentCooccurrence:
    """Co-occurrence of softly binned lightness and two opponent colours at two distances.

    The picture is smoothed on the object alone (`smooth_px`), halved in size and exposed so that the object has a fixed
    mean lightness. A pixel belongs to up to eight bins at once by linear weights, so a small change of light moves a
    little of the histogram instead of all of it. Pairs lie `near_px` and `far_px` apart in the halved picture. The
    histogram sums to 1.
    """

    smooth_px: Annotated[float, Field(gt=0, le=20)] = 1.5
    near_px: Annotated[int, Field(ge=1, le=31)] = 2
    far_px: Annotated[int, Field(ge=1, le=63)] = 5
    lightness: Annotated[int, Field(ge=2, le=12)] = 5
    opponents: Annotated[int, Field(ge=2, le=8)] = 3

    @property
    def name(self) -> str:
        """Registered name."""
        return "opponent"

    @property
    def parameters(self) -> dict[str, float | int | str]:
        """What the features depend on."""
        return {
            "smooth_px": self.smooth_px,
            "near_px": self.near_px,
            "far_px": self.far_px,
            "lightness": self.lightness,
            "opponents": self.opponents,
        }

    @property
    def size(self) -> int:
        """Pairs of bins at two distances."""
        return 2 * (self._bins * (self._bins + 1) // 2)

    def describe(self, image: Array, mask: Array | None) -> Array:
        """(H, W, 3) uint8 RGB and (H, W) bool -> (D,) float32. Raises BadInput when the mask leaves no pixel pair."""
        weights, index = self._weights(image, mask)
        parts = [self._pairs(weights, index, distance) for distance in (self.near_px, self.far_px)]
        feature = np.concatenate(parts)
        total = float(feature.sum())
        if total <= 0.0:
            raise BadInput(
                f"the object covers too little of the picture: no two pixels of it are {2 * self.near_px} px apart"
            )
        return (feature / total).astype(np.float32)

    def similarity(self, feature: Array, features: Array) -> FloatArray:
        """Bhattacharyya's coefficient: (D,) against (N, D) -> (N,) float64 in [0, 1]."""
        product: FloatArray = (np.sqrt(features) @ np.sqrt(feature)).astype(np.float64)
        return product

    @property
    def _bins(self) -> int:
        return self.lightness * self.opponents**2

    @cached_property
    def _upper(self) -> tuple[Array, Array]:
        rows, columns = np.triu_indices(self._bins)
        return rows, columns

    def _weights(self, image: Array, mask: Array | None) -> tuple[Array, Array]:
        """(N, bins) float32 of the N pixels on the object, and (h, w) int32 their numbers, -1 elsewhere."""
        channels, inside = opponent_colours(image, mask, self.smooth_px)
        index = np.full(inside.shape, -1, np.int32)
        index[inside] = np.arange(int(inside.sum()))
        light, red_green, yellow_blue = channels[inside].T
        soft = np.einsum(
            "ni,nj,nk->nijk",
            _soft(light, 0.0, 0.9, self.lightness),
            _soft(red_green, -0.5, 0.6, self.opponents),
            _soft(yellow_blue, -0.4, 0.8, self.opponents),
        )
        return soft.reshape(len(light), self._bins), index

    def _pairs(self, weights: Array, index: Array, distance: int) -> Array:
        """(bins (bins + 1) / 2,) how often two bins lie so far apart, in all directions."""
        counts = np.zeros((self._bins, self._bins), np.float32)
        height, width = index.shape
        for step in range(HALF_TURN):
            angle = step * np.pi / HALF_TURN
            dy, dx = round(distance * np.sin(angle)), round(distance * np.cos(angle))
            a = index[max(0, -dy) : height - max(0, dy), max(0, -dx) : width - max(0, dx)]
            b = index[max(0, dy) : height + min(0, dy), max(0, dx) : width + min(0, dx)]
            both = (a >= 0) & (b >= 0)
            counts += weights[a[both]].T @ weights[b[both]]
        pairs = counts + counts.T
        upper: Array = pairs[self._upper]
        total = float(upper.sum())
        return upper / total if total > 0 else upper


def _soft(values: Array, low: float, high: float, bins: int) -> Array:
    """(N,) -> (N, bins) float32 linear weights that sum to 1."""
    place = np.clip((values - low) / (high - low), 0.0, 1.0) * (bins - 1)
    below = np.minimum(place.astype(np.int32), bins - 2)
    rest = (place - below).astype(np.float32)
    weights = np.zeros((len(values), bins), np.float32)
    row = np.arange(len(values))
    weights[row, below] = 1.0 - rest
    weights[row, below + 1] = rest
    return weights
