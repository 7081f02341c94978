"""The seed's planner: explore until the poses have converged, then drive to the separating view (section IV.E)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from viewsep.geometry import angle_between
from viewsep.interfaces import Interpretation, NextView
from viewsep.messages import FloatArray, Phase
from viewsep.models.aspect_graph import AspectGraph
from viewsep.planning.exploration import EXPLORATIONS, Exploration, GeodesicExploration, SphericalExploration
from viewsep.planning.reachable import ReachableViews
from viewsep.planning.separating_view import SIMILARITY_DIRECTIONS, similarity_graph

NODE_REACH_RAD = np.radians(12.0)  # about half a node spacing: a view this close shows what the node stands for


@dataclass(frozen=True, slots=True)
class SeparatingOptions:
    """Settings of the separating-view planner.

    `exploration` is `geodesic` or the seed's `spherical`; `start` a `random` reachable view or the `current` one;
    `step_deg` the length of one movement; `apart_deg` how far a further separating view must lie from earlier ones.
    """

    exploration: Exploration = "geodesic"
    start: Literal["random", "current"] = "random"
    step_deg: Annotated[float, Field(ge=1, le=90)] = 10.0
    apart_deg: Annotated[float, Field(ge=0, le=180)] = 30.0


@dataclass(frozen=True, eq=False, slots=True)
class PlannerState:
    """`way` (N, 3) are the waypoints still to drive to, the last one being the separating view; `visited` (V, 3)."""

    exploration: GeodesicExploration | SphericalExploration
    way: FloatArray
    visited: FloatArray


class SeparatingViewPlanner:
    """Explores, then approaches the view where the plausible candidates differ most, then the next best one."""

    options_type = SeparatingOptions
    state_type = PlannerState

    def __init__(
        self, models: Sequence[AspectGraph], reachable: ReachableViews, options: SeparatingOptions | None = None
    ) -> None:
        self.models = list(models)
        self.reachable = reachable
        self.options = options or SeparatingOptions()
        # views that lie far apart show what lies up to half way to the next one
        self._reach_rad = max(NODE_REACH_RAD, 0.5 * reachable.spacing_rad)
        self._shown = reachable.nearest(SIMILARITY_DIRECTIONS)

    def start(self, seed: int, view_direction: FloatArray) -> tuple[PlannerState, NextView]:
        """A random start view and a random direction from it (section III.C)."""
        rng = np.random.default_rng(seed)
        start = view_direction
        if self.options.start == "random":
            start = self.reachable.directions[rng.integers(len(self.reachable.directions))]
        kind = EXPLORATIONS[self.options.exploration]
        state = PlannerState(kind.start(rng, start, self._step_rad), np.empty((0, 3)), np.empty((0, 3)))
        return state, NextView(start if self.options.start == "random" else None, Phase.STARTING)

    def next_view(
        self, state: PlannerState, view_direction: FloatArray, belief: Interpretation | None
    ) -> tuple[PlannerState, NextView]:
        """The next waypoint to the separating view; without one, the next step of the exploration."""
        if belief is not None and belief.fresh:
            state = replace(state, way=np.empty((0, 3)))
        if len(state.way) == 0 and belief is not None and belief.converged:
            state = self._choose_target(state, view_direction, belief)
        if len(state.way) > 0:
            target, waypoint, rest = state.way[-1], state.way[0], state.way[1:]
            arrives = len(rest) == 0
            visited = np.concatenate([state.visited, target[None]]) if arrives else state.visited
            return replace(state, way=rest, visited=visited), NextView(waypoint, Phase.APPROACHING, target, arrives)
        exploration, view = state.exploration.next_view(view_direction, self.reachable)
        return replace(state, exploration=exploration), NextView(view, Phase.EXPLORING)

    @property
    def _step_rad(self) -> float:
        return float(np.radians(self.options.step_deg))

    def _choose_target(self, state: PlannerState, view: FloatArray, belief: Interpretation) -> PlannerState:
        """Plan the way to the reachable view with the highest mean variance that was not tried yet."""
        models = [model for model, plausible in zip(self.models, belief.plausible, strict=True) if plausible]
        graph = similarity_graph(models, belief.rotations[belief.plausible])
        score = graph.smoothed
        for node in np.argsort(-score, kind="stable"):
            if score[node] <= 0.0:
                break
            shown = self._shown[node]
            tried = (angle_between(state.visited, shown) < np.radians(self.options.apart_deg)).any()
            if not tried and angle_between(shown, graph.directions[node]) <= self._reach_rad:
                return replace(state, way=self.reachable.path(view, shown, self._step_rad))
        return replace(state, visited=np.empty((0, 3)))  # everything was tried: explore on, then begin again
