"""How probable everybody is, given that models may be wrong: Bayes alone takes them for the truth and is too sure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import softmax

from viewsep.geometry import rotation_angle
from viewsep.interpretation.contrast import contrast, moderated
from viewsep.interpretation.filter_state import FilterOptions, FilterState
from viewsep.interpretation.holding import SHIFTED_RAD
from viewsep.interpretation.posterior import FURTHEST
from viewsep.interpretation.predictions import Predictions
from viewsep.interpretation.refinement import REFINED_BELOW_RAD
from viewsep.interpretation.rotation_grid import rotation_grid
from viewsep.interpretation.view_cells import cell_of
from viewsep.messages import BoolArray, FloatArray

NO_BETTER = 3.0  # logarithms of probabilities: about as likely as none of them
CLOSE = 60.0  # logarithms of probabilities: nearer candidates are compared with the first one look by look
FAR = 0.9 * FURTHEST  # about as far as the posterior lets a candidate fall: the sum of all looks' evidence goes on
ALIKE_RAD = np.radians(8.0)  # between the poses of two models that err alike
PLACE_RAD = np.radians(12.0)  # around a view that must not decide alone who it is
REGION_RAD = np.radians(45.0)  # nor that it is nobody: a model may be wrong in a whole region
MODEL_WRONG = 0.03  # how probable that is


@dataclass(frozen=True, eq=False, slots=True)
class Judgement:
    """Probabilities of the candidates (K,) and of none of them, which sum to 1.

    `another` is the part of `none` that is an object like the likeliest candidate but for one region.
    """

    probability: FloatArray
    none: float
    another: float


def judged(
    predictions: Predictions,
    options: FilterOptions,
    state: FilterState,
    posed: Sequence[int],
    rotations: FloatArray,
    variance: FloatArray,
) -> Judgement:
    """How probable everybody is, given that models err between their views.

    `posed` are the likeliest candidates that are followed, in order; `rotations` (K, 3, 3) and `variance` (K,) are
    theirs. None of them is as probable as without the region that speaks most for it; but the object may be one that
    was not learned and is like the likeliest candidate except in that region.
    """
    *probabilities, none = _moderated(predictions, options, state, posed, rotations, variance)
    probability = np.array(probabilities)
    if none > 1.0 - options.confidence:
        less = min(none, least_probability(options, state, len(probability), REGION_RAD))
        probability *= (1.0 - less) / max(1.0 - none, 1e-300)
        none = less
    first = posed[0]
    another = probability[first] * _another(predictions, options, state, first, rotations[first])
    probability[first] -= another
    return Judgement(probability, float(none + another), float(another))


def corroborated(options: FilterOptions, state: FilterState, who: int, probability: FloatArray) -> bool:
    """Whether candidate `who` is as good as certain by `probability` (K,), and no single place decides that.

    A model errs in the same way wherever one looks from about the same place.
    """
    certain = probability[who] >= options.confidence
    return bool(certain and least_probability(options, state, who, PLACE_RAD) >= options.corroborated)


def least_probability(options: FilterOptions, state: FilterState, who: int, apart_rad: float) -> float:
    """The least probability of `who` (K: none of them) without the looks from around any one of them."""
    elsewhere = state.views @ state.views.T <= np.cos(apart_rad)
    with np.errstate(divide="ignore"):
        without = np.repeat((np.log(state.prior[who]) - np.log(state.prior))[None], len(elsewhere), axis=0)
    for counts, gain in zip(elsewhere.T, state.gains[:, [who]] - state.gains, strict=True):
        np.add(without, gain, out=without, where=counts[:, None])
        np.minimum(np.maximum(without, -options.floor, out=without), options.floor, out=without)
    without[:, state.prior == 0.0] = np.inf  # ruled out from the start
    return float((1.0 / np.exp(-without).sum(axis=1)).min())


def speaks_against(predictions: Predictions, state: FilterState, k: int) -> float:
    """The evidence for none of them and against candidate k from the region where it is largest, in nats.

    It is as much less as the model may err; 0 where a single place decides that, or where looks from elsewhere do not
    speak for the candidate.
    """
    cosine = state.views @ state.views.T
    near, place = cosine > np.cos(REGION_RAD), cosine > np.cos(PLACE_RAD)
    each = (state.gains[:, -1] - state.gains[:, k]).astype(np.float64)
    most = int(np.argmax(near @ each))
    against = np.where(near[most], each, 0.0)
    if (against.sum() - place @ against).min() < NO_BETTER or each[~near[most]].sum() > -NO_BETTER:
        return 0.0
    error2 = 2.0 * predictions.log_error2 * (near[most] @ state.shares)
    return float(moderated(against.sum(), error2))


def _another(
    predictions: Predictions, options: FilterOptions, state: FilterState, k: int, rotation: FloatArray
) -> float:
    """The probability that what looks like candidate k, held in `rotation`, is another object that differs in a region.

    That region may be anywhere, and speaks as much for a model that is wrong there. A pose that was lost and is found
    again as it was has not slipped: what spoke against it still does.
    """
    told = speaks_against(predictions, state, k)
    if state.lost.who == k and rotation_angle(rotation, state.lost.rotation) < SHIFTED_RAD:
        told = max(told, state.lost.told)
    if told <= NO_BETTER:
        return 0.0
    region = 0.5 * (1.0 - np.cos(REGION_RAD)) * np.exp(min(told, options.floor))
    another, wrong = 0.5 * options.unknown_prior * region, MODEL_WRONG * region
    return float(another / (1.0 + wrong + another))


def foreseen(predictions: Predictions, options: FilterOptions, state: FilterState, k: int) -> BoolArray:
    """(L,) which looks a candidate has views for, held as is likeliest: elsewhere it foretells nothing."""
    rotation = int(np.argmax(state.posterior.log_p[np.searchsorted(state.posterior.active, k)]))
    seen = state.views @ rotation_grid(options.rotations)[rotation]
    return np.asarray(predictions.known(k, cell_of(*seen.T)))


def _moderated(
    predictions: Predictions,
    options: FilterOptions,
    state: FilterState,
    posed: Sequence[int],
    rotations: FloatArray,
    variance: FloatArray,
) -> FloatArray:
    """(K + 1,) probabilities averaged over how wrong the evidence for the likeliest candidate may be.

    It is not where both models have their views in the same places and are held alike: there the errors cancel. And a
    candidate whose pose stays open, and that explains the looks no better than none of them does, is no look-alike
    whose views could err.
    """
    log, leader = state.posterior.log_shares(), posed[0]
    with np.errstate(divide="ignore"):
        log_gained = state.gains.sum(axis=0, dtype=np.float64) + np.log(state.prior)
    no_better = log_gained[leader] - log_gained[-1] - NO_BETTER
    alike = np.append(predictions.layout == predictions.layout[leader], True)  # none of them has no views that err
    for k in posed:
        alike[k] &= float(rotation_angle(rotations[k], rotations[leader])) < ALIKE_RAD
    evidence = log[leader] - log
    far = np.flatnonzero(evidence[:-1] > FAR)
    evidence[far] = np.maximum(evidence[far], (log_gained[leader] - log_gained)[far])
    settled = np.append((variance < REFINED_BELOW_RAD**2) & (variance[leader] < REFINED_BELOW_RAD**2), False)
    alike |= (evidence > no_better) & ~(settled & (evidence < CLOSE))
    error2 = np.where(alike, 0.0, 2.0 * predictions.log_error2 * state.shares.sum())
    for k in (k for k in posed[1:] if not alike[k]):
        expected = state.shares * foreseen(predictions, options, state, k)
        error2[k] = 2.0 * predictions.log_error2 * expected.sum()
        if evidence[k] < CLOSE and settled[k]:
            cells, others = (cell_of(*(state.views @ rotations[who]).T) for who in (leader, k))
            told, error2[k] = contrast(predictions, state.looks, state.shares, leader, cells, k, others)
            evidence[k] = told + np.log(state.prior[leader] / state.prior[k])
    return np.asarray(softmax(-moderated(evidence, error2)))
