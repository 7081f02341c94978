"""How likely a residual is: Student's t, whose scale and tail are learned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from viewsep.messages import Array, FloatArray

FREEDOMS = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 20.0, 40.0)
ITERATIONS = 30


@dataclass(frozen=True, slots=True)
class Law:
    """Student's t in `dimensions` dimensions with `freedom` degrees of freedom; `scale2` is a variance per dimension.

    The fewer degrees of freedom, the heavier its tail: a bad look (occluded, dropped mask) then decides less.
    """

    dimensions: int
    freedom: float
    scale2: float

    def log(self, distance2: Array) -> Array:
        """(...) squared distances -> (...) float32 log densities."""
        constant = np.float32(self._constant) - np.float32(0.5 * self.dimensions) * np.log(np.float32(self.scale2))
        density: Array = constant + self.log_share(distance2)
        return density

    def log_share(self, distance2: Array) -> Array:
        """(...) squared distances -> (...) float32 logarithms of what the density is of that at a distance of 0."""
        power = np.float32(-0.5 * (self.freedom + self.dimensions))
        share: Array = power * np.log1p(distance2 / (np.float32(self.freedom) * np.float32(self.scale2)))
        return share

    @property
    def _constant(self) -> float:
        f, m = self.freedom, self.dimensions
        return float(gammaln(0.5 * (f + m)) - gammaln(0.5 * f) - 0.5 * m * np.log(f * np.pi))

    def weight(self, distance2: Array) -> Array:
        """How much a residual counts for the scale: less the further out it is."""
        weights: Array = (self.freedom + self.dimensions) / (self.freedom + distance2 / self.scale2)
        return weights

    @staticmethod
    def fit(distance2: FloatArray, dimensions: int, freedoms: Sequence[float] = FREEDOMS) -> Law:
        """The most likely law of squared distances (R,), by expectation maximisation for every tail."""
        laws = []
        for freedom in freedoms:
            law = Law(dimensions, freedom, max(float(np.median(distance2)) / dimensions, 1e-9))
            for _ in range(ITERATIONS):
                scale2 = float(np.mean(law.weight(distance2) * distance2)) / dimensions
                law = Law(dimensions, freedom, max(scale2, 1e-9))
            laws.append(law)
        best = int(np.argmax([law.log(distance2).sum(dtype=np.float64) for law in laws]))
        return laws[best]
