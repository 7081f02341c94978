"""When a candidate's pose has settled (section IV.E)."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

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
    angles = Rotation.from_matrix(difference.reshape(-1, 3, 3)).as_rotvec().reshape(len(means), count, 3)
    variance: FloatArray = angles.var(axis=0).sum(axis=1)
    return variance
