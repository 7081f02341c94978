"""Two candidates laid over each other in the poses in which they show the most alike."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from viewsep.geometry import axis_rotation, fibonacci_sphere, rotation_angle
from viewsep.interpretation.predictions import DISTURBED, Predictions
from viewsep.interpretation.rotation_grid import rotation_grid
from viewsep.interpretation.view_cells import CELLS, cell_areas, cell_of
from viewsep.messages import Array, BoolArray, FloatArray

SEARCHED, SAMPLED = 6000, 160  # rotations about 11 degrees apart, and views that each is judged by
STARTS, KEPT = 12, 4  # different rotations that are refined, and that are kept of them
STEPS_DEG = (6.0, 3.0, 1.5)
APART_RAD = np.radians(20.0)  # kept rotations are that different
COMMON = 0.6  # of the views of the model that has fewer must be known in both: less is no comparison
ITSELF_RAD = np.radians(30.0)  # a model is compared with itself turned by more than that


def overlays(predictions: Predictions, first: int, second: int) -> FloatArray:
    """(S, 3, 3) rotations from the first one's frame into the second's in which they are most alike, the best first.

    They differ from each other. Where the candidates know parts of the sphere only, poses in which they have too little
    in common do not count. With `first` equal to `second`: those of an object with itself, turned.
    """
    searched, cells = _search()
    judge = _Judge.of(predictions, first, second)
    score = judge.scores(cells)
    if first == second:
        score = np.where(rotation_angle(searched, np.eye(3)) > ITSELF_RAD, score, np.inf)
    starts = _different(searched, score, STARTS)
    refined, score = _refined(searched[starts], score[starts], judge)
    if first == second:  # what has slid down to where nothing is turned
        score = np.where(rotation_angle(refined, np.eye(3)) > ITSELF_RAD, score, np.inf)
    return refined[_different(refined, score, KEPT)]


def everywhere(predictions: Predictions, candidate: int) -> tuple[Array, BoolArray]:
    """(CELLS, M) what a candidate shows in every cell, and (CELLS,) whether it has views there."""
    cells = np.arange(CELLS)
    return predictions.prediction(candidate, cells), predictions.known(candidate, cells)


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
        (shown, known), (others, others_known) = everywhere(predictions, first), everywhere(predictions, second)
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
