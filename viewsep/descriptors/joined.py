"""Several descriptors at once, as if they were one: the seed's multi-modal claim (section II.2)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np

from viewsep.interfaces import Descriptor
from viewsep.messages import Array, FloatArray

JOINT = "+"
"""Between the names: `opponent+rings`."""


class JoinedDescriptor:
    """The features of several descriptors one after the other, each with the same share.

    What each of them counts for is not decided here: the pose filter learns it.
    """

    def __init__(self, parts: Sequence[Descriptor]) -> None:
        self.parts = tuple(parts)
        self._ends = [0, *accumulate(part.size for part in self.parts)]

    @property
    def name(self) -> str:
        """The parts' names."""
        return JOINT.join(part.name for part in self.parts)

    @property
    def parameters(self) -> dict[str, float | int | str]:
        """The parts' parameters, each behind its part's name and a point."""
        return {f"{part.name}.{key}": value for part in self.parts for key, value in part.parameters.items()}

    @property
    def size(self) -> int:
        """Of all parts together."""
        return self._ends[-1]

    def describe(self, image: Array, mask: Array | None) -> Array:
        """(H, W, 3) uint8 RGB and (H, W) bool -> (D,) float32. Raises BadInput where a part does."""
        features = [part.describe(image, mask) for part in self.parts]
        return np.concatenate(features) / np.float32(len(self.parts))

    def similarity(self, feature: Array, features: Array) -> FloatArray:
        """The mean of the parts' similarities: (D,) against (N, D) -> (N,) float64."""
        scale = np.float32(len(self.parts))
        similarities = [
            part.similarity(scale * feature[begin:end], scale * features[:, begin:end])
            for part, (begin, end) in zip(self.parts, pairwise(self._ends), strict=True)
        ]
        mean: FloatArray = np.mean(similarities, axis=0)
        return mean
