"""The bootstrap: how much a figure of several tasks depends on which tasks they were."""

from __future__ import annotations

import numpy as np

from viewsep.messages import Array, FloatArray

RESAMPLES = 2000


def resamples(tasks: int, rng: np.random.Generator) -> Array:
    """(RESAMPLES, tasks) int: how often each of the tasks is drawn when as many are drawn with replacement."""
    return rng.multinomial(tasks, np.full(tasks, 1.0 / tasks), size=RESAMPLES)


def interval95(values: FloatArray) -> list[float]:
    """The middle 95 % of a figure's values over the resamples (percentile bootstrap)."""
    return [float(bound) for bound in np.percentile(values, [2.5, 97.5])]
