"""Rotations spread evenly over SO(3): where the pose filter keeps its probabilities.

Super-Fibonacci spirals (Alexa 2022, "Super-Fibonacci Spirals: Fast, Low-Discrepancy Sampling of SO(3)").
"""

from __future__ import annotations

from functools import cache

import numpy as np

from viewsep.messages import FloatArray

_PHI = np.sqrt(2.0)
_PSI = 1.533751168755204288118041  # the root of psi^4 = psi + 4


@cache
def rotation_grid(count: int) -> FloatArray:
    """(count, 3, 3) rotations, read-only; the mean distance to the nearest neighbour falls with count^(-1/3)."""
    place = np.arange(count) + 0.5
    share = place / count
    turn = 2.0 * np.pi * place
    inner, outer = np.sqrt(share), np.sqrt(1.0 - share)
    a, b = turn / _PHI, turn / _PSI
    quaternions = np.stack([inner * np.sin(a), inner * np.cos(a), outer * np.sin(b), outer * np.cos(b)], axis=1)
    grid = matrices(quaternions)
    grid.setflags(write=False)
    return grid


def matrices(quaternions: FloatArray) -> FloatArray:
    """(N, 4) unit quaternions x, y, z, w -> (N, 3, 3) rotation matrices."""
    x, y, z, w = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0).copy()
