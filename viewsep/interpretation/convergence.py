"""When a candidate's pose has settled (section IV.E)."""

from __future__ import annotations

import numpy as np

from viewsep.geometry import mean_rotation
from viewsep.messages import FloatArray

WINDOW = 5


def running_variance(means: FloatArray) -> FloatArray:
    """(W, K, 3, 3) mean rotations of the last iterations -> (K,) variance summed over the three angles, rad².

    Infinite until the window of 5 is full. The angles are those of the rotation vector away from the window's mean,
    which unlike Euler angles has no singularity nearby.
    """
    count = means.shape[1]
    if len(means) < WINDOW:
        return np.full(count, np.inf)
    centre = mean_rotation(means)
    difference = centre.swapaxes(-1, -2) @ means
    variance: FloatArray = _rotation_vectors(difference).var(axis=0).sum(axis=1)
    return variance


def _rotation_vectors(rotations: FloatArray) -> FloatArray:
    """(..., 3, 3) -> axis times angle (..., 3); about x for the half turns, whose axis the skew part does not show."""
    skew = 0.5 * np.stack(
        [
            rotations[..., 2, 1] - rotations[..., 1, 2],
            rotations[..., 0, 2] - rotations[..., 2, 0],
            rotations[..., 1, 0] - rotations[..., 0, 1],
        ],
        axis=-1,
    )
    sine = np.sqrt((skew * skew).sum(axis=-1))
    cosine = 0.5 * (np.trace(rotations, axis1=-2, axis2=-1) - 1.0)
    angle = np.arctan2(sine, cosine)
    vectors: FloatArray = skew * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 1.0)[..., None]
    half_turn = (sine <= 1e-9) & (cosine < 0.0)
    vectors[half_turn] = (np.pi, 0.0, 0.0)
    return vectors
