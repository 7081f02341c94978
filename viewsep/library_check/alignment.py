"""Two models laid over each other in the pose in which looks tell least between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
from scipy.spatial import cKDTree

from viewsep.geometry import axis_rotation, fibonacci_sphere, rotation_angle, spacing_of
from viewsep.interpretation.predictions import CALM, DISTURBED, Predictions
from viewsep.interpretation.rotation_grid import rotation_grid
from viewsep.interpretation.view_cells import CELLS, cell_directions, cell_of
from viewsep.messages import Array, BoolArray, FloatArray
from viewsep.models.aspect_graph import AspectGraph

SEARCHED, SAMPLED = 6000, 160  # rotations about 11 degrees apart, and views that each is judged by
STARTS, KEPT = 12, 4  # different rotations that are refined, and that are kept of them
STEPS_DEG = (6.0, 3.0, 1.5)
APART_RAD = np.radians(20.0)  # kept rotations are that different
COMMON = 0.6  # of the views of the model that has fewer must be known in both: less is no comparison
ELSEWHERE = 0.3  # of the spacing of views: from the nearest of them when they lie anywhere
ITSELF_RAD = np.radians(30.0)  # a model is compared with itself turned by more than that


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


@cache
def cell_areas() -> FloatArray:
    """(CELLS,) shares of the sphere, read-only."""
    parts = np.abs(cell_directions())
    main = parts.max(axis=1)
    area = ((main**2)[:, None] + parts**2).prod(axis=1) / (2.0 * main**3)  # the main one gives 2 main^2
    shares: FloatArray = area / area.sum()
    shares.setflags(write=False)
    return shares


def alignments(candidates: Candidates, first: int, second: int) -> list[Alignment]:
    """The different poses in which the two candidates are most alike, the most alike one first; empty without any.

    Where the models know parts of the sphere only, poses in which they have too little in common do not count.
    With `first` equal to `second`: those of an object with itself, turned.
    """
    searched, cells = _search()
    judge = _Judge.of(candidates.predictions, first, second)
    score = judge.scores(cells)
    if first == second:
        score = np.where(rotation_angle(searched, np.eye(3)) > ITSELF_RAD, score, np.inf)
    starts = _different(searched, score, STARTS)
    refined, score = _refined(searched[starts], score[starts], judge)
    if first == second:  # what has slid down to where nothing is turned
        score = np.where(rotation_angle(refined, np.eye(3)) > ITSELF_RAD, score, np.inf)
    kept = _different(refined, score, KEPT)
    found = [aligned(candidates, first, second, rotation) for rotation in refined[kept]]
    return sorted(found, key=lambda alignment: alignment.mean)


def aligned(candidates: Candidates, first: int, second: int, rotation: FloatArray) -> Alignment:
    """What looks tell between two candidates with the second one turned by `rotation` (3, 3) against the first.

    Of what the second shows close to a view the most alike counts: no pose is known better than that.
    """
    predictions, differing = candidates.predictions, candidates.differing_views(first, second, rotation)
    (shown, known), (others, others_known) = _shown(predictions, first), _shown(predictions, second)
    at = cell_of(*(cell_directions() @ rotation.T).T)
    distance2 = np.full(CELLS, np.inf, np.float32)
    for near in _next_to().T:
        difference = shown - others[near[at]]
        distance2 = np.minimum(distance2, np.einsum("ce,ce->c", difference, difference))
    both = known & others_known[at]
    bits = np.where(both, bits_of(predictions, distance2, differing).astype(np.float64), np.nan)
    mean = float((bits * cell_areas())[both].sum() / cell_areas()[both].sum()) if both.any() else 0.0
    return Alignment(rotation, bits, mean)


@dataclass(frozen=True, eq=False, slots=True)
class _Judge:
    """How unlike two candidates are: `unlike` (SAMPLED, CELLS) of a view of the first and a cell of the second.

    It grows with the logarithm of the distance: a pose that is nearly right is found better than by bits, which are
    all or nothing a few degrees away. `common` says where both have views; `least` is how many such views must be.
    """

    unlike: Array
    common: BoolArray
    least: float

    @staticmethod
    def of(predictions: Predictions, first: int, second: int) -> _Judge:
        (shown, known), (others, others_known) = _shown(predictions, first), _shown(predictions, second)
        views = _sampled_cells()
        law = predictions.laws[DISTURBED]
        scale = np.float32(law.dimensions * law.scale2)
        unlike = np.log1p(np.maximum(_distances2(shown[views], others), 0.0) / scale)
        fewer = min(float(known[views].mean()), float(others_known @ cell_areas()))
        return _Judge(unlike.ravel(), (known[views][:, None] & others_known).ravel(), COMMON * fewer * len(views))

    def scores(self, cells: Array) -> FloatArray:
        """(G, SAMPLED) cells of the second object's sphere -> (G,) means over the views that both know."""
        at = cells + np.arange(cells.shape[1]) * CELLS
        values, common = self.unlike[at], self.common[at]
        count = common.sum(axis=1)
        mean = np.einsum("gv,gv->g", values, common) / np.maximum(count, 1)
        return np.where(count >= max(self.least, 1.0), mean, np.inf)


def _different(rotations: FloatArray, score: FloatArray, count: int) -> list[int]:
    """Indices of up to `count` rotations (R, 3, 3) with the lowest finite scores (R,) that differ from each other."""
    left = np.where(np.isfinite(score), score, np.inf)
    chosen: list[int] = []
    while len(chosen) < count and np.isfinite(left).any():
        chosen.append(int(np.argmin(left)))
        left = np.where(rotation_angle(rotations, rotations[chosen[-1]]) < APART_RAD, np.inf, left)
    return chosen


def _alignment(
    predictions: Predictions, first: tuple[Array, BoolArray], second: tuple[Array, BoolArray], rotation: FloatArray
) -> Alignment:
    at = cell_of(*(cell_directions() @ rotation.T).T)
    difference = first[0] - second[0][at]
    bits = bits_of(predictions, np.einsum("ce,ce->c", difference, difference)).astype(np.float64)
    both = first[1] & second[1][at]
    mean = float((bits * cell_areas())[both].sum() / cell_areas()[both].sum()) if both.any() else 0.0
    return Alignment(rotation, np.where(both, bits, np.nan), mean)


def _refined(rotations: FloatArray, score: FloatArray, judge: _Judge) -> tuple[FloatArray, FloatArray]:
    """Downhill in steps about three axes, smaller and smaller, for all rotations (S, 3, 3) at once."""
    rotations, score = rotations.copy(), score.copy()
    for step in np.radians(STEPS_DEG):
        turns = np.array([axis_rotation(sign * axis, step) for axis in np.eye(3) for sign in (1.0, -1.0)])
        for _ in range(3):
            tried = np.einsum("tij,sjk->stik", turns, rotations)
            seen = np.einsum("stij,vj->stvi", tried, fibonacci_sphere(SAMPLED))
            at = cell_of(*np.moveaxis(seen, 3, 0))
            values = judge.scores(at.reshape(-1, SAMPLED)).reshape(at.shape[:2])
            best = np.argmin(values, axis=1)
            better = values[np.arange(len(best)), best] < score
            if not better.any():
                break
            rotations[better] = tried[better, best[better]]
            score[better] = values[better, best[better]]
    return rotations, score


def _distances2(shown: Array, others: Array) -> Array:
    """(V, M) and (C, M) -> (V, C) squared distances."""
    own, theirs = np.einsum("ve,ve->v", shown, shown), np.einsum("ce,ce->c", others, others)
    distances2: Array = own[:, None] + theirs - 2.0 * shown @ others.T
    return distances2


@lru_cache(maxsize=64)
def _shown(predictions: Predictions, candidate: int) -> tuple[Array, BoolArray]:
    """(CELLS, M) what a candidate shows in every cell, and (CELLS,) whether it has views there."""
    cells = np.arange(CELLS)
    return predictions.prediction(candidate, cells), predictions.known(candidate, cells)


@cache
def _next_to() -> Array:
    """(CELLS, 9) each cell and those around it."""
    return np.asarray(cKDTree(cell_directions()).query(cell_directions(), k=9)[1])


@cache
def _sampled_cells() -> Array:
    """(SAMPLED,) cells of evenly spread views."""
    return cell_of(*fibonacci_sphere(SAMPLED).T)


@cache
def _search() -> tuple[FloatArray, Array]:
    """(SEARCHED, 3, 3) rotations, and (SEARCHED, SAMPLED) the cells where each puts the views."""
    rotations = rotation_grid(SEARCHED)
    seen = np.einsum("gij,vj->gvi", rotations, fibonacci_sphere(SAMPLED))
    return rotations, cell_of(*np.moveaxis(seen, 2, 0))
