"""Next views by the information they promise about who is seen, for every second of motion (design section 5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from viewsep.geometry import angle_between, fibonacci_sphere
from viewsep.interfaces import Conclusion, Interpretation, NextView, PoseSamples
from viewsep.interpretation.unlearned import predictions_of
from viewsep.messages import Array, FloatArray, Outcome, Phase
from viewsep.models.aspect_graph import AspectGraph
from viewsep.planning.exploration import GeodesicExploration
from viewsep.planning.promise import promised
from viewsep.planning.reachable import ReachableViews, shows

ON_THE_WAY_RAD = np.radians(10.0)  # between the looks that a motion is taken to give
UNREACHABLE_VIEWS = 200  # on the whole sphere, where a view is looked for that would help
WORTH_SAYING = 5.0  # times what a reachable view must promise
STILL_LIKELY, TOGETHER = 0.05, 0.9  # share of the likeliest one's probability, and sum, of candidates that are alike
SIDES = 200  # that stand for all that is yet to be seen
SURE_OF_IT = 0.95  # of the best view's information on the way: the rest stays open


@dataclass(frozen=True, slots=True)
class InformationOptions:
    """`step_deg` is the shortest movement, `longest_deg` the longest, `views` how many reachable views are weighed.

    `settling_s` is what a movement takes beside turning. A view that promises fewer than `least_bits` about the
    candidate promises nothing; after `patience` plans in a row in which none does, with a known pose, the candidates
    are indistinguishable, with an unknown one after `lost_patience`.
    """

    step_deg: Annotated[float, Field(ge=1, le=90)] = 10.0
    longest_deg: Annotated[float, Field(ge=1, le=180)] = 60.0
    views: Annotated[int, Field(ge=10, le=5000)] = 150
    settling_s: Annotated[float, Field(ge=0, le=10)] = 0.4
    least_bits: Annotated[float, Field(gt=0, lt=1)] = 0.02
    patience: Annotated[int, Field(ge=1, le=1000)] = 4
    lost_patience: Annotated[int, Field(ge=1, le=1000)] = 30


@dataclass(frozen=True, eq=False, slots=True)
class InformationState:
    """How it explores while no view promises anything, and for how many plans in a row that has been so."""

    exploration: GeodesicExploration
    idle: int = 0


class InformationPlanner:
    """Drives to where the looks, those on the way too, are expected to tell the most about the candidate in a second.

    When the name is known and the pose is asked for, it is the pose they should tell.
    """

    needs_samples = True
    options_type = InformationOptions
    state_type = InformationState

    def __init__(
        self, models: Sequence[AspectGraph], reachable: ReachableViews, options: InformationOptions | None = None
    ) -> None:
        self.options = options or InformationOptions()
        self.reachable = reachable
        self.predictions = predictions_of(tuple(models))
        every = max(1, len(reachable.directions) // self.options.views)
        self._views = reachable.directions[::every]
        self._view_of = np.argmax(reachable.directions @ self._views.T, axis=1)  # of every direction the nearest
        self._anywhere = fibonacci_sphere(UNREACHABLE_VIEWS)

    def start(self, seed: int, view_direction: FloatArray) -> tuple[InformationState, NextView]:
        """Where the rig is: any view is as good as another before the first look."""
        rng = np.random.default_rng(seed)
        exploration = GeodesicExploration.start(rng, view_direction, self._step_rad)
        return InformationState(exploration), NextView(None, Phase.STARTING)

    def next_view(
        self, state: InformationState, view_direction: FloatArray, belief: Interpretation | None
    ) -> tuple[InformationState, NextView]:
        """Towards the view with the most information per second; exploring where none promises anything."""
        if belief is None or len(belief.samples.weight) == 0:
            return self._explore(state, view_direction)
        if len(belief.unseen):
            return state, self._around(view_direction, belief.unseen)
        promise = promised(self.predictions, belief.samples, self._views)
        wanted = promise.pose if belief.conclusion else promise.candidate
        if wanted.max() >= self.options.least_bits:
            return replace(state, idle=0), self._towards(view_direction, wanted)
        state = replace(state, idle=state.idle + 1)
        patience = self.options.patience if belief.converged or belief.conclusion else self.options.lost_patience
        if state.idle >= patience:
            concluded = self._concluded(belief)
            if concluded is not None:
                return state, NextView(None, Phase.EXPLORING, conclusion=concluded)
        if promise.pose.max() >= self.options.least_bits:
            return state, self._towards(view_direction, promise.pose)
        return self._explore(state, view_direction)

    def _around(self, here: FloatArray, unseen: FloatArray) -> NextView:
        """The movement on which the most of what is `unseen` (U, 3) comes into view in a second."""
        sides = unseen[:: max(1, len(unseen) // SIDES)]
        node, there, length = self.reachable.ways(here, self._views, ON_THE_WAY_RAD)
        shown = (shows(self.reachable.directions, sides)[node] & there[..., None]).any(axis=1).mean(axis=1)
        rate = np.where(length < 0.5 * self._step_rad, 0.0, shown / self._duration_s(length))
        return self._movement(here, self._views[int(np.argmax(rate))])

    def _explore(self, state: InformationState, view: FloatArray) -> tuple[InformationState, NextView]:
        exploration, direction = state.exploration.next_view(view, self.reachable)
        return replace(state, exploration=exploration), NextView(direction, Phase.EXPLORING)

    def _towards(self, here: FloatArray, bits: FloatArray) -> NextView:
        """A movement to the best target or to the first view on the way that is half as good."""
        straight = angle_between(np.broadcast_to(here, self._views.shape), self._views)
        elsewhere = straight >= 0.5 * self._step_rad  # here it has looked already
        elsewhere |= not elsewhere.any()
        best = np.array([np.argmax(np.where(elsewhere, bits / self._duration_s(straight), -1.0))])
        (least,) = self._rate(here, best, bits)
        may_be_better = np.flatnonzero(elsewhere & (bits.max() / self._duration_s(straight) >= least))
        target = self._views[may_be_better[np.argmax(self._rate(here, may_be_better, bits))]]
        return self._movement(here, target, bits)

    def _movement(self, here: FloatArray, target: FloatArray, bits: FloatArray | None = None) -> NextView:
        """Towards `target` (3,), as far as a movement may be, or to the first view half as good as the best there."""
        path = self.reachable.path(here, target, ON_THE_WAY_RAD)
        far = np.cumsum(angle_between(np.vstack([here, path[:-1]]), path))
        shortest = int(np.searchsorted(far, self._step_rad - 1e-6))
        longest = max(0, int(np.searchsorted(far, np.radians(self.options.longest_deg) + 1e-6)) - 1)
        stop = longest
        if bits is not None:
            good = bits[np.argmax(path @ self._views.T, axis=1)]
            stop = min(max(int(np.argmax(good >= 0.5 * good.max())), shortest), longest)
        view = path[min(stop, len(path) - 1)]
        return NextView(view, Phase.APPROACHING, target, arrives=True)  # it waits there for a look

    def _rate(self, here: FloatArray, targets: Array, bits: FloatArray) -> FloatArray:
        """(T,) bits for every second of the movements to `targets` (T,), those of the looks on the way together.

        They share what there is to know: no movement gives more than the best of all views.
        """
        node, there, length = self.reachable.ways(here, self._views[targets], ON_THE_WAY_RAD)
        limit = float(bits.max())
        seen = np.where(there, bits[self._view_of[node]], 0.0)
        gain = limit * (1.0 - np.prod(1.0 - SURE_OF_IT * seen / limit, axis=1))
        return np.asarray(gain / self._duration_s(length))

    def _duration_s(self, length_rad: FloatArray) -> FloatArray:
        return self.options.settling_s + length_rad / self.reachable.speed_rad_s

    def _concluded(self, belief: Interpretation) -> Conclusion | None:
        """Why going on is of no use; None where it is none of the candidates that are likely."""
        if belief.conclusion is not None:
            return Conclusion(Outcome.IDENTIFIED, "no view that this rig can show promises more about its pose")
        probability = np.array([candidate.probability or 0.0 for candidate in belief.estimate.candidates])
        alike = np.flatnonzero(probability > STILL_LIKELY * probability.max())
        if len(alike) < 2 or probability[alike].sum() < TOGETHER:
            return None
        reason = "no view that this rig can show tells them apart"
        return Conclusion(
            Outcome.INDISTINGUISHABLE, reason, tuple(int(k) for k in alike), self._telling_view(belief.samples)
        )

    def _telling_view(self, samples: PoseSamples) -> FloatArray | None:
        """Of the views out of reach the one that promises the most, where that is anything."""
        views = self._anywhere[~self.reachable.reaches(self._anywhere)]
        if len(views) == 0:
            return None
        bits = promised(self.predictions, samples, views).candidate
        best = int(np.argmax(bits))
        return views[best] if bits[best] >= WORTH_SAYING * self.options.least_bits else None

    @property
    def _step_rad(self) -> float:
        return float(np.radians(self.options.step_deg))
