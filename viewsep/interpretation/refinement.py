"""A pose finer than the grid: rotations around the most likely one are judged by the latest looks together."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from viewsep.interpretation.predictions import Predictions
from viewsep.interpretation.view_cells import cell_of
from viewsep.messages import Array, FloatArray

BALLS_DEG = ((16.0, 8.0), (9.0, 3.0))  # reach and step of the rotations that are tried, around the best and then finer
REFINED_BELOW_RAD = np.radians(15.0)  # of spread: else there is more than one way to hold it
LATEST = 24  # looks that judge them
LEAST_SHARE = 0.15  # of evidence of its own, for a look to be among them
REGION_RAD = np.radians(30.0)  # within which a model errs in one way
REGION_ERROR_RAD = np.radians(7.0)  # of a pose from looks at one region, however many agree


@cache
def _ball(reach_deg: float, step_deg: float) -> tuple[FloatArray, FloatArray]:
    """(J, 3) rotation vectors in a ball, and (J, 3, 3) the rotations."""
    steps = np.radians(np.arange(-reach_deg, reach_deg + step_deg, step_deg))
    vectors = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    vectors = vectors[np.linalg.norm(vectors, axis=1) <= np.radians(reach_deg) + 1e-9]
    return vectors, Rotation.from_rotvec(vectors).as_matrix()


def refined(
    predictions: Predictions, candidate: int, rotation: FloatArray, looks: Array, views: FloatArray, shares: FloatArray
) -> tuple[FloatArray, float]:
    """The mean rotation near `rotation` (3, 3) and the mean squared angle to it, from looks (L, M) at views (L, 3)."""
    chosen = np.flatnonzero(shares >= LEAST_SHARE)[-LATEST:]
    if len(chosen) == 0:
        return rotation, float("inf")
    looks, views, shares = looks[chosen], views[chosen], shares[chosen]
    spread = 0.0
    for ball in BALLS_DEG:
        vectors, turns = _ball(*ball)
        seen = views @ (turns @ rotation)
        log = predictions.log_at(looks, candidate, cell_of(*np.moveaxis(seen, 2, 0))) @ shares
        weight = np.exp(log - log.max())
        weight /= weight.sum()
        mean = weight @ vectors
        spread = float(weight @ ((vectors - mean) ** 2).sum(axis=1))
        rotation = Rotation.from_rotvec(mean).as_matrix() @ rotation
    return rotation, spread + REGION_ERROR_RAD**2 / _regions(views)


def _regions(views: FloatArray) -> int:
    """How many of the views (L, 3) lie in regions of their own."""
    apart, count = views @ views.T < np.cos(REGION_RAD), 0
    free = np.ones(len(views), bool)
    for view, others in enumerate(apart):
        if free[view]:
            count += 1
            free &= others
    return count
