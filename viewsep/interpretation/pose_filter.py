"""Exact Bayes over (candidate or none of them) x rotation, on a grid (design section 5).

In an estimate `rating` is one over the candidate's probability, `w0` how well the look fits it at best (0 to 1), `w1`
the spread of its pose (radians); `w2` has no meaning here and is 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import logsumexp

from viewsep.geometry import angle_between
from viewsep.interfaces import Conclusion, Descriptor, Interpretation, PoseSamples
from viewsep.interpretation.filter_state import FilterOptions, FilterState, Lost
from viewsep.interpretation.holding import Held, compared
from viewsep.interpretation.independence import independent_share
from viewsep.interpretation.judgement import CLOSE, Judgement, corroborated, judged, speaks_against
from viewsep.interpretation.posterior import Posterior, RotationGrid, spacing_rad_of
from viewsep.interpretation.refinement import REFINED_BELOW_RAD, refined
from viewsep.interpretation.unlearned import predictions_of
from viewsep.messages import Array, CandidateEstimate, Estimate, FloatArray, HypothesisViews, Outcome, Percept, Phase
from viewsep.models.aspect_graph import AspectGraph

SHOWN = 50  # hypotheses per candidate that are shown to people
POSED = 8  # likeliest candidates whose poses are worked out
SAMPLED, SAMPLES, FEWEST_SAMPLES = 5, 40, 8  # candidates, and rotations of all and of each, that stand for all
PROMOTED = 8  # parked candidates that are taken up again in one step at most
DOUBT = 0.05  # least weight of a plausible candidate's samples
DOUBTFUL = 0.2  # of being another object than the one it looks like, at which more looks are no use
CALM_BOUNDS = (0.02, 0.98)  # of the probability that looks are clean: the light may change


class FilterInterpreter:
    """The posterior over who is seen and how it is held."""

    gives_samples = True
    options_type = FilterOptions
    state_type = FilterState

    def __init__(
        self, models: Sequence[AspectGraph], descriptor: Descriptor, options: FilterOptions | None = None
    ) -> None:
        self.options = options or FilterOptions()
        self.predictions = predictions_of(tuple(models))
        self.grid = RotationGrid(self.options.rotations)
        self._log_prior = self.grid.log_prior(np.radians(self.options.upright_within_deg), self.options.floor)

    def start(self) -> FilterState:
        """Every candidate and rotation as likely as any other."""
        count, none = len(self.predictions.names), self.options.unknown_prior
        prior = np.append(np.full(count, (1.0 - none) / count), none)
        empty = np.empty((0, self.predictions.dimensions), np.float32)
        gains = np.empty((0, count + 1), np.float32)
        return FilterState(self._opened(prior), prior, empty, np.empty((0, 3)), np.empty(0), gains)

    def update(self, state: FilterState, percept: Percept) -> tuple[FilterState, Interpretation]:
        """Multiply with the likelihood of the percept, as far as it is evidence of its own."""
        look, view = self.predictions.project(percept.feature), percept.view_direction
        turned = 1.0
        if len(state.views):
            turned = min(1.0, float(angle_between(state.views[-1], view)) / self._independent_rad)
        share = min(turned, float(independent_share(view[None], state.views, self._independent_rad)[0]))
        spacing = spacing_rad_of(self.options.rotations)
        noise = turned * min(1.0, (np.radians(self.options.motion_noise_deg) / spacing) ** 2)
        before = state.posterior.diffused(noise, self.options.rotations)
        nearest2 = self.predictions.nearest2(look)
        seen = self._seen(before, look, view, share, state.calm, nearest2)
        after = replace(
            state,
            posterior=seen.normalised(self.options.floor),
            looks=np.concatenate([state.looks, look[None]]),
            views=np.concatenate([state.views, view[None]]),
            shares=np.append(state.shares, share),
            gains=np.concatenate([state.gains, _gains(state.posterior, seen)[None]]),
            count=state.count + 1,
        )
        lost = bool(after.posterior.none > np.log(0.5))  # the looks have stopped to fit any candidate
        slipped = state.settled and lost and state.slips < self.options.slips
        if slipped:
            after = self._searched_anew(state, after, nearest2)
        after = self._follow(after)
        after = replace(after, calm=self._calm(after, share))
        interpretation = self._interpret(after, percept, slipped, nearest2)
        held, interpretation = compared(after.held, interpretation)
        return replace(after, settled=interpretation.converged, held=held), interpretation

    @property
    def _independent_rad(self) -> float:
        return float(np.radians(self.options.independent_after_deg))

    def hypotheses(self, state: FilterState, stamp_ns: int) -> HypothesisViews:
        """The most likely rotations of every candidate that is followed, where they believe the last view to be."""
        active, log_p = state.posterior.active, state.posterior.log_p
        best = np.argpartition(-log_p, SHOWN, axis=1)[:, :SHOWN]
        weight = np.exp(np.take_along_axis(log_p, best, axis=1)).astype(np.float64).ravel()
        view = state.views[-1] if len(state.views) else np.zeros(3)
        seen = np.repeat(view[None], len(active) * SHOWN, axis=0)
        owner = np.repeat(active, SHOWN)
        return HypothesisViews(stamp_ns, self.predictions.names, owner, seen, weight / max(weight.sum(), 1e-300))

    def _opened(self, prior: FloatArray) -> Posterior:
        """Candidates and none of them with probabilities (K + 1,), every rotation as likely as any other."""
        with np.errstate(divide="ignore"):
            log_prior, log_none = np.log(prior[:-1]), float(np.log(prior[-1]))
        active = np.sort(np.argsort(-log_prior, kind="stable")[: self.options.followed])
        log_p = (log_prior[active][:, None] + self._log_prior).astype(np.float32)
        parked = log_prior.copy()
        parked[active] = -np.inf
        return Posterior(active, log_p, parked, log_none)

    def _seen(
        self, posterior: Posterior, look: Array, view: FloatArray, share: float, calm: float, nearest2: Array
    ) -> Posterior:
        likelihood = np.float32(share) * self.predictions.log_likelihood(look, posterior.active, calm)
        best = share * self.predictions.log_of_distance2(nearest2, calm).astype(np.float64)
        none = share * self.predictions.log_of_others
        return posterior.times(likelihood, self.grid.cells(view), best, none)

    def _searched_anew(self, before: FilterState, after: FilterState, nearest2: Array) -> FilterState:
        """The object has slipped: who it is stays likely, how it is held is open; only the last look counts."""
        known = before.posterior.probabilities()
        none = self.options.unknown_prior
        prior = np.append((1.0 - none) * (0.5 * known / known.sum() + 0.5 / len(known)), none)
        look, view = after.looks[-1], after.views[-1]
        opened = self._opened(prior)
        seen = self._seen(opened, look, view, 1.0, after.calm, nearest2)
        return replace(
            after,
            posterior=seen.normalised(self.options.floor),
            prior=prior,
            looks=look[None],
            views=view[None],
            shares=np.ones(1),
            gains=_gains(opened, seen)[None],
            slips=before.slips + 1,
            held=Held(),
            lost=self._lost(before, after),
        )

    def _lost(self, before: FilterState, after: FilterState) -> Lost:
        """Whose pose was lost, and what spoke against it."""
        who = int(np.argmax(before.posterior.probabilities()))
        if who not in before.held.who:
            return before.lost
        told = speaks_against(self.predictions, after, who)
        return Lost(who, before.held.rotations[before.held.who.index(who)], told)

    def _follow(self, state: FilterState) -> FilterState:
        """Of a large library, take up parked candidates that rate better than followed ones, in their place."""
        posterior = state.posterior
        if len(posterior.active) == len(posterior.parked):
            return state
        rating = posterior.parked.copy()
        rating[posterior.active] = posterior.log_p.max(axis=1) - self._log_prior.max()
        order = np.argsort(-rating, kind="stable")[: self.options.followed]
        order = order[rating[order] > rating.max() - self.options.floor]
        new = [k for k in order if k not in posterior.active]
        if len(state.shares) > 1:
            new = new[:PROMOTED]
        active = np.sort(np.concatenate([np.intersect1d(order, posterior.active), np.array(new, int)]))
        rows = dict(zip(posterior.active.tolist(), posterior.log_p, strict=True))
        replayed, gained = self._replayed(state, np.array(new, int))
        rows |= zip(new, replayed, strict=True)
        gains = state.gains.copy()
        gains[:, new] = gained
        parked = posterior.parked.copy()
        parked[posterior.active] = posterior.log_mass
        parked[active] = -np.inf
        follows = Posterior(active, np.stack([rows[k] for k in active]), parked, posterior.none, posterior.evidence)
        return replace(state, posterior=follows.normalised(self.options.floor), gains=gains)

    def _replayed(self, state: FilterState, candidates: Array) -> tuple[Array, Array]:
        """(A,) candidates -> (A, G) what their rotations would be, had they been followed, and (L, A) their gains."""
        log_p = np.log(state.prior[candidates])[:, None] + self._log_prior - state.posterior.evidence
        mass = [logsumexp(log_p, axis=1)]
        for look, view, share in zip(state.looks, state.views, state.shares, strict=True):
            likelihood = self.predictions.log_likelihood(look, candidates, state.calm)
            log_p += share * likelihood[:, self.grid.cells(view)]
            mass.append(logsumexp(log_p, axis=1))
        return log_p.astype(np.float32), np.diff(mass, axis=0).astype(np.float32)

    def _calm(self, state: FilterState, share: float) -> float:
        """The probability that looks are clean, from how the last one differs from what the best rotation predicts."""
        posterior = state.posterior
        a, rotation = np.unravel_index(np.argmax(posterior.log_p), posterior.log_p.shape)
        cell = int(self.grid.cells(state.views[-1])[rotation])
        worse = self.predictions.disturbance(state.looks[-1], int(posterior.active[a]), cell)
        odds = np.log(state.calm / (1.0 - state.calm)) - share * worse
        return float(np.clip(1.0 / (1.0 + np.exp(-odds)), *CALM_BOUNDS))

    def _interpret(self, state: FilterState, percept: Percept, slipped: bool, nearest2: Array) -> Interpretation:
        posterior = state.posterior
        followed = set(posterior.active.tolist())
        order = np.argsort(-posterior.log_shares()[:-1], kind="stable")
        posed = [int(k) for k in order if int(k) in followed][:POSED]
        rotations, variance = self._poses(state, posed)
        limit = np.radians(self.options.pose_within_deg) ** 2
        judgement = judged(self.predictions, self.options, state, posed, rotations, variance)
        probability, none = judgement.probability, judgement.none
        leader = int(order[0]) if corroborated(self.options, state, int(order[0]), probability) else -1
        plausible = probability > 0.01 * probability.max()
        plausible[order[:2]] = True
        fit = self.predictions.fit(nearest2)
        candidates = tuple(
            CandidateEstimate(
                name=name,
                rating=float(1.0 / max(probability[k], 1e-12)),
                w0=float(fit[k]),
                w1=float(np.sqrt(variance[k])),
                w2=0.0,
                rotation=rotations[k],
                variance=float(variance[k]),
                converged=bool(variance[k] < limit),
                hypotheses=self.options.rotations if k in followed else 0,
                probability=float(probability[k]),
            )
            for k, name in enumerate(self.predictions.names)
        )
        estimate = Estimate(
            stamp_ns=percept.stamp_ns,
            iteration=state.count,
            phase=Phase.EXPLORING,
            candidates=candidates,
            comparisons=len(self.predictions.views),
            travel_rad=0.0,
            target=None,
            unknown=none,
            note="looks stopped to fit, as if the object had slipped: its pose is searched anew" if slipped else "",
        )
        return Interpretation(
            estimate,
            rotations,
            converged=bool(variance[order[0]] < limit and posterior.none < np.log(0.5)),
            plausible=plausible,
            leader=leader,
            fresh=slipped,
            conclusion=self._concluded(state, leader, judgement),
            samples=self._samples(state, [k for k in posed if plausible[k]][:SAMPLED], probability),
        )

    def _poses(self, state: FilterState, posed: Sequence[int]) -> tuple[FloatArray, FloatArray]:
        """(K, 3, 3), and (K,) mean squared angles, of the candidates `posed`, finer where they are close to the first.

        Those of others are infinite.
        """
        posterior, count = state.posterior, len(self.predictions.names)
        log = posterior.log_shares()
        rotations, variance = np.repeat(np.eye(3)[None], count, axis=0), np.full(count, np.inf)
        for k in posed:
            rotations[k], variance[k] = self.grid.pose(*posterior.likely(k))
            if log[k] > log[posed[0]] - CLOSE and variance[k] < REFINED_BELOW_RAD**2:
                seen = state.looks, state.views, state.shares
                rotations[k], variance[k] = refined(self.predictions, k, rotations[k], *seen)
        return rotations, variance

    def _concluded(self, state: FilterState, leader: int, judgement: Judgement) -> Conclusion | None:
        after = f"after {state.count} looks"
        if state.slips:
            after += f", {state.slips} of its poses lost on the way" if state.slips > 1 else ", its pose lost once"
        if leader >= 0:
            return Conclusion(Outcome.IDENTIFIED, f"its probability is {judgement.probability[leader]:.4f} {after}")
        if judgement.none >= self.options.confidence:
            return Conclusion(Outcome.UNKNOWN, f"the probability of that is {judgement.none:.4f} {after}")
        first = int(np.argmax(judgement.probability))
        sure = judgement.probability[first] + judgement.another >= self.options.confidence
        if sure and judgement.another >= DOUBTFUL:
            seen = f"it looks like {self.predictions.names[first]}, but from one side like nothing that was learned"
            return Conclusion(Outcome.UNDECIDED, f"{seen}: it is something new, or the model is wrong there; {after}")
        return None

    def _samples(self, state: FilterState, chosen: Sequence[int], probability: FloatArray) -> PoseSamples:
        """Rotations of the chosen candidates as likely as they are, each candidate with its probability as weight.

        Nobody's weight is so small that looks which would still tell against the leader promise nothing.
        """
        owner, rotation, weight = [], [], []
        each = max(FEWEST_SAMPLES, SAMPLES // max(1, len(chosen)))
        for k in chosen:
            likely, log_p = state.posterior.likely(k)
            below = np.cumsum(np.exp(log_p, dtype=np.float64))
            drawn = np.searchsorted(below, (np.arange(each) + 0.5) / each * below[-1])
            distinct, times = np.unique(drawn, return_counts=True)
            owner.append(np.full(len(distinct), k))
            rotation.append(self.grid.rotations[likely[distinct]])
            weight.append(times * (max(probability[k], DOUBT) / each))
        if not owner:
            return PoseSamples()
        return PoseSamples(
            np.concatenate(owner),
            np.concatenate(rotation),
            np.concatenate(weight),
            state.views,
            self._independent_rad,
        )


def _gains(before: Posterior, after: Posterior) -> Array:
    """(K + 1,) by how much the logarithms of probabilities rose; 0 of what is ruled out from the start."""
    with np.errstate(invalid="ignore"):
        return np.nan_to_num(after.log_shares() - before.log_shares(), nan=0.0).astype(np.float32)
