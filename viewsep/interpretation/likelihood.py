"""How likely a percept is where a model predicts another feature: a heavy-tailed law. Its scale is set by hand.

Features are compared in an embedding in which their similarity is an inner product. So a feature between nodes can be
predicted as a mixture of theirs, and the distances to all mixtures follow from the inner products with the nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from viewsep.interpretation.view_cells import CELLS, Interpolation
from viewsep.messages import Array
from viewsep.models.aspect_graph import AspectGraph


@dataclass(frozen=True, slots=True)
class Law:
    """Student's t in D `dimensions` with f degrees of `freedom`: log p = -(f + D) / 2 log(1 + d2 / (f s2)) + const.

    `scale2` is the squared distance that is usual between a percept and its prediction, `background2` that of a view of
    something else; how surprising a percept of an unknown object is follows from the latter.
    """

    dimensions: float = 6.0
    freedom: float = 4.0
    scale2: float = 0.02
    background2: float = 0.25

    def log(self, distance2: Array) -> Array:
        """(...) squared distances -> (...) float32 log-likelihoods, 0 at distance 0."""
        power = np.float32(-0.5 * (self.freedom + self.dimensions))
        scaled: Array = power * np.log1p(distance2 * np.float32(1.0 / (self.freedom * self.scale2)))
        return scaled

    @property
    def of_nothing(self) -> float:
        """The log-likelihood of any view of an object that is no candidate."""
        return float(self.log(np.array(self.background2, np.float32)))


LAWS = {"opponent": Law(scale2=0.006, background2=0.08)}
"""Of descriptors whose distances are not those of the colour co-occurrence histogram; set by hand, not yet learned."""


class Library:
    """All candidates' nodes as one matrix, and what each of them predicts in every cell."""

    def __init__(self, models: Sequence[AspectGraph], law: Law) -> None:
        self.names = tuple(model.name for model in models)
        self.law = law
        self._nodes = embedded(np.concatenate([model.features for model in models]))
        starts = np.cumsum([0, *(len(model.directions) for model in models[:-1])])
        parts = [Interpolation.of(model) for model in models]
        self._node = np.stack([part.node + start for part, start in zip(parts, starts, strict=True)])  # (K, CELLS, 3)
        self._weight = np.stack([part.weight for part in parts])
        self._covered = np.stack([part.covered for part in parts])
        self._norm2 = np.stack([self._predicted_norm2(k) for k in range(len(models))])

    @property
    def nodes(self) -> int:
        """How many views all models have together."""
        return len(self._nodes)

    def log_likelihood(self, feature: Array) -> Array:
        """(D,) -> (K, CELLS) float32: of the percept if candidate k is seen from a cell."""
        product = self._nodes @ embedded(feature[None])[0]
        predicted = np.einsum("kcj,kcj->kc", self._weight, product[self._node])
        distance2 = np.maximum(1.0 - 2.0 * predicted + self._norm2, 0.0)
        return np.where(self._covered, self.law.log(distance2), np.float32(self.law.of_nothing))

    def prediction(self, k: int, cells: Array) -> Array:
        """(N,) cells -> (N, E) what candidate k shows there."""
        shown: Array = np.einsum("nj,nje->ne", self._weight[k, cells], self._nodes[self._node[k, cells]])
        return shown

    def _predicted_norm2(self, k: int) -> Array:
        """(CELLS,) squared length of the mixtures, which are shorter than the features they are made of."""
        result = np.empty(CELLS, np.float32)
        for begin in range(0, CELLS, 512):
            cells = np.arange(begin, min(begin + 512, CELLS))
            shown = self.prediction(k, cells)
            result[cells] = np.einsum("ne,ne->n", shown, shown)
        return result


def embedded(features: Array) -> Array:
    """(N, D) histograms -> (N, D) float32 of length 1, whose inner product is Bhattacharyya's coefficient."""
    roots: Array = np.sqrt(np.maximum(features, 0.0), dtype=np.float32)
    length = np.linalg.norm(roots, axis=1, keepdims=True)
    return roots / np.where(length > 0, length, 1.0).astype(np.float32)
