"""How well a score tells tasks with a property from tasks without it: the ROC curve and the area under it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from viewsep.bench.resampling import interval95, resamples
from viewsep.messages import FloatArray


def auc(without: Sequence[float], having: Sequence[float]) -> float | None:
    """The probability that a task with the property scores higher than one without it, ties counting half.

    None where one of the two kinds is missing.
    """
    return float(_wins(without, having).mean()) if len(without) and len(having) else None


def auc_bootstrap95(without: Sequence[float], having: Sequence[float], seed: int = 0) -> list[float] | None:
    """Its 95 % interval; tasks are drawn anew within each kind, so that neither is missing from a resample."""
    if not len(without) or not len(having):
        return None
    rng = np.random.default_rng([seed, 11])
    drawn_without, drawn_having = resamples(len(without), rng), resamples(len(having), rng)
    won = ((drawn_having @ _wins(without, having)) * drawn_without).sum(axis=1)
    return interval95(won / (len(without) * len(having)))


def roc_curve(without: Sequence[float], having: Sequence[float]) -> FloatArray:
    """(N, 2) share of tasks without and with the property that score at least as high as a threshold, from high to low.

    Begins at (0, 0), ends at (1, 1).
    """
    thresholds = np.unique([*without, *having])[::-1]
    shares = [(np.asarray(scores)[None] >= thresholds[:, None]).mean(axis=1) for scores in (without, having)]
    return np.vstack([[0.0, 0.0], np.stack(shares, axis=1)])


def _wins(without: Sequence[float], having: Sequence[float]) -> FloatArray:
    """(H, W): 1 where the task with the property scores higher, a half where they are equal, else 0."""
    higher, lower = np.asarray(having)[:, None], np.asarray(without)[None]
    wins: FloatArray = (higher > lower) + 0.5 * (higher == lower)
    return wins
