"""Looks from almost the same view err in the same way: how much of a look is evidence of its own.

What a model lacks is seen again from nearby, light and noise are new. A look's error is taken as the sum of both: the
first falls off exponentially with the angle, the second is independent. With their correlations C, all looks together
are then worth 1' C^-1 1 independent ones (generalised least squares), and a further look is worth by how much that
grows: on a path about one per `independent_rad`, and however often a place is looked at, little more than one.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dposv

from viewsep.messages import FloatArray

LACKING = 0.82  # of a look's squared error, what the model lacks: a repeated look is worth a tenth


def independent_share(views: FloatArray, seen: FloatArray, independent_rad: float) -> FloatArray:
    """(V,) what a further look from each of (V, 3) views is worth after those `seen` (L, 3); 1 without any."""
    if len(seen) == 0:
        return np.ones(len(views))
    among = _correlation(seen, seen, independent_rad)
    np.fill_diagonal(among, 1.0)
    across = _correlation(views, seen, independent_rad)
    _, solved, _ = dposv(among, np.vstack([np.ones(len(seen)), across]).T)  # by Cholesky: it is positive definite
    news = 1.0 - across @ solved[:, 0]
    uncertain = 1.0 - np.einsum("vl,lv->v", across, solved[:, 1:])
    share: FloatArray = np.minimum(news**2 / uncertain, 1.0)
    return share


def _correlation(views: FloatArray, others: FloatArray, independent_rad: float) -> FloatArray:
    """(V, W) of the errors of looks from (V, 3) and (W, 3) views."""
    angle = np.arccos(np.clip(views @ others.T, -1.0, 1.0))
    correlation: FloatArray = LACKING * np.exp(-2.0 * angle / independent_rad)
    return correlation
