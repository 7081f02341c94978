"""Two models laid over each other in the pose in which looks tell least between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.spatial import cKDTree

from viewsep.geometry import spacing_of
from viewsep.interpretation.overlay import everywhere, overlays
from viewsep.interpretation.predictions import CALM, Predictions
from viewsep.interpretation.view_cells import CELLS, cell_areas, cell_directions, cell_of
from viewsep.messages import Array, FloatArray
from viewsep.models.aspect_graph import AspectGraph

ELSEWHERE = 0.3  # of the spacing of views: from the nearest of them when they lie anywhere


@dataclass(frozen=True, eq=False, slots=True)
class Alignment:
    """`rotation` (3, 3) turns the first object's frame into the second's; `bits` (CELLS,) is what one look tells.

    `bits` is over the cells of the first object's sphere, in [0, 1], NaN where not both models have views; `mean` is
    their mean over the sphere.
    """

    rotation: FloatArray
    bits: FloatArray
    mean: float


@dataclass(frozen=True, eq=False)
class Candidates:
    """The models of a library, and what all of them together predict."""

    models: tuple[AspectGraph, ...]
    predictions: Predictions

    @staticmethod
    def of(models: Sequence[AspectGraph]) -> Candidates:
        """Raises as the predictions do."""
        return Candidates(tuple(models), Predictions(models))

    @property
    def names(self) -> tuple[str, ...]:
        """In their order."""
        return self.predictions.names

    def differing_views(self, first: int, second: int, rotation: FloatArray) -> float:
        """How much the views of two models lie elsewhere in this pose: 0 at the same places, 1 anywhere."""
        a, b = self.models[first].directions @ rotation.T, self.models[second].directions
        gap = np.asarray(cKDTree(b).query(a)[0])
        return float(np.clip(np.median(gap) / (ELSEWHERE * spacing_of(b)), 0.0, 1.0))


def bits_of(predictions: Predictions, distance2: Array, differing_views: float = 0.0) -> Array:
    """Squared distances between what two objects show -> bits that a look tells about which of the two it is.

    Both are equally likely before. It is what the planner goes by: the overlap of looks (Bhattacharyya's, of the
    tempered laws) bounds the entropy that remains. Two models of the same object differ, too, where their views lie
    elsewhere (`differing_views`, 0 to 1): as much as clean looks differ from predictions. That is no difference.
    """
    nothing = np.zeros(1, np.float32)
    calm = predictions.laws[CALM]
    beyond = np.maximum(distance2 - 2.0 * differing_views * calm.dimensions * calm.scale2, 0.0)
    quarter = beyond.astype(np.float32) * np.float32(0.25)
    overlaps = [
        np.exp(np.float32(predictions.temper) * (law.log(quarter) - law.log(nothing))) for law in predictions.laws
    ]
    bits: Array = 1.0 - np.log2(1.0 + 0.5 * (overlaps[0] + overlaps[1]))
    return bits


def confusion_of(bits: FloatArray) -> FloatArray:
    """Bits of a look -> the probability that it shows the wrong one of the two as the likelier, at the most."""
    confusion: FloatArray = 0.5 * (2.0 ** (1.0 - bits) - 1.0)
    return confusion


def alignments(candidates: Candidates, first: int, second: int) -> list[Alignment]:
    """The different poses in which the two candidates are most alike, the most alike one first; empty without any.

    Where the models know parts of the sphere only, poses in which they have too little in common do not count.
    With `first` equal to `second`: those of an object with itself, turned.
    """
    overlaid = overlays(candidates.predictions, first, second)
    found = [aligned(candidates, first, second, rotation) for rotation in overlaid]
    return sorted(found, key=lambda alignment: alignment.mean)


def aligned(candidates: Candidates, first: int, second: int, rotation: FloatArray) -> Alignment:
    """What looks tell between two candidates with the second one turned by `rotation` (3, 3) against the first.

    Of what the second shows close to a view the most alike counts: no pose is known better than that.
    """
    predictions, differing = candidates.predictions, candidates.differing_views(first, second, rotation)
    (shown, known), (others, others_known) = everywhere(predictions, first), everywhere(predictions, second)
    at = cell_of(*(cell_directions() @ rotation.T).T)
    distance2 = np.full(CELLS, np.inf, np.float32)
    for near in _next_to().T:
        difference = shown - others[near[at]]
        distance2 = np.minimum(distance2, np.einsum("ce,ce->c", difference, difference))
    both = known & others_known[at]
    bits = np.where(both, bits_of(predictions, distance2, differing).astype(np.float64), np.nan)
    mean = float((bits * cell_areas())[both].sum() / cell_areas()[both].sum()) if both.any() else 0.0
    return Alignment(rotation, bits, mean)


@cache
def _next_to() -> Array:
    """(CELLS, 9) each cell and those around it."""
    return np.asarray(cKDTree(cell_directions()).query(cell_directions(), k=9)[1])
