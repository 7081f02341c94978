"""Looks from almost the same view err in the same way: how much of a look is evidence of its own."""

from __future__ import annotations

import numpy as np

from viewsep.geometry import nearest_points
from viewsep.messages import FloatArray

REPEATED = 0.1  # of a look from where it was looked from before: light and noise are new, what the model lacks is not


def independent_share(views: FloatArray, seen: FloatArray, independent_rad: float) -> FloatArray:
    """(V,) of (V, 3) views, growing with the angle to the nearest of the views `seen` (L, 3); 1 without any."""
    if len(seen) == 0:
        return np.ones(len(views))
    chord = nearest_points(seen, views)[0]
    angle = 2.0 * np.arcsin(np.minimum(0.5 * chord, 1.0))
    share: FloatArray = np.clip(angle / independent_rad, REPEATED, 1.0)
    return share
