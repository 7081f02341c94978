"""A pose finer than the grid: rotations around the most likely one are judged by the latest looks together."""

from __future__ import annotations

from functools import cache

import numpy as np
from scipy.spatial.transform import Rotation

from viewsep.interpretation.predictions import Predictions
from viewsep.interpretation.view_cells import cell_of
from viewsep.messages import Array, FloatArray

REACH_DEG, STEP_DEG = 12.0, 3.0  # of the rotations that are tried
LATEST = 16  # looks that judge them
MODEL_ERROR_DEG = 3.0  # by which poses are off even where all looks agree: models are no better between their views
LEAST_SHARE = 0.3  # of evidence of its own, for a look to be among them


@cache
def _around() -> tuple[FloatArray, FloatArray]:
    """(J, 3) rotation vectors in a ball, and (J, 3, 3) the rotations."""
    steps = np.radians(np.arange(-REACH_DEG, REACH_DEG + STEP_DEG, STEP_DEG))
    vectors = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    vectors = vectors[np.linalg.norm(vectors, axis=1) <= np.radians(REACH_DEG) + 1e-9]
    return vectors, Rotation.from_rotvec(vectors).as_matrix()


def refined(
    predictions: Predictions, candidate: int, rotation: FloatArray, looks: Array, views: FloatArray, shares: FloatArray
) -> tuple[FloatArray, float]:
    """The mean rotation near `rotation` (3, 3) and the mean squared angle to it, from looks (L, M) at views (L, 3)."""
    chosen = np.flatnonzero(shares >= LEAST_SHARE)[-LATEST:]
    if len(chosen) == 0:
        return rotation, float("inf")
    vectors, turns = _around()
    seen = np.einsum("lk,jki->jli", views[chosen], turns @ rotation)
    cells = cell_of(*np.moveaxis(seen, 2, 0))
    log = predictions.log_at(looks[chosen], candidate, cells) @ shares[chosen]
    weight = np.exp(log - log.max())
    weight /= weight.sum()
    mean = weight @ vectors
    spread = float(weight @ ((vectors - mean) ** 2).sum(axis=1))
    better: FloatArray = Rotation.from_rotvec(mean).as_matrix() @ rotation
    return better, spread + np.radians(MODEL_ERROR_DEG) ** 2
