"""How much looks tell two candidates apart, given that models err between their views.

What a model predicts between its views is wrong by about as much as look-alikes differ. Where the views of two models
lie in different places these errors do not cancel: the evidence of a look is then a difference that is wrong by both.
It counts where the models differ by more than they err, and the probability is averaged over what is left of the error.
"""

from __future__ import annotations

import numpy as np

from viewsep.interpretation.predictions import CALM, Predictions
from viewsep.messages import Array, FloatArray


def contrast(
    predictions: Predictions, looks: Array, shares: FloatArray, one: int, cells: Array, other: int, others: Array
) -> tuple[float, float]:
    """The evidence for candidate `one` against `other`, and the variance of its error.

    From looks (L, M) that count (L,), seen in (L,) `cells` of the one, or in `others` of the other. Every look has the
    weight of what it would tell (a matched filter), which depends on the models alone; none where one has no view.
    """
    told = predictions.log_at(looks, one, cells[None])[0] - predictions.log_at(looks, other, others[None])[0]
    apart = predictions.prediction(one, cells) - predictions.prediction(other, others)
    weight = expected(predictions, (apart * apart).sum(axis=1))
    weight *= predictions.known(one, cells) & predictions.known(other, others)
    if not weight.any():
        return 0.0, 0.0
    weight /= weight.max()
    return float((weight * shares) @ told), float(2.0 * predictions.log_error2 * (weight**2 @ shares))


def expected(predictions: Predictions, apart2: Array) -> FloatArray:
    """(...) squared distances between what two models predict -> (...) the evidence that a look there should give.

    It is what the models differ by more than they err.
    """
    law, typical2 = predictions.laws[CALM], predictions.typical2
    more2 = np.maximum(apart2 - 2.0 * typical2, 0.0)
    steps = law.log(np.array([typical2], np.float32)) - law.log((typical2 + more2).astype(np.float32))
    return np.asarray(predictions.temper * steps.astype(np.float64))


def moderated(evidence: FloatArray, error2: FloatArray) -> FloatArray:
    """(N,) log-odds whose evidence is wrong by a variance `error2` (N,), averaged over it (MacKay 1992)."""
    return np.asarray(evidence / np.sqrt(1.0 + np.pi / 8.0 * error2))
