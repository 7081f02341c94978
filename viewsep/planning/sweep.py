"""A systematic sweep through all reachable views, whatever was seen: what a planner that thinks has to beat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from viewsep.geometry import angle_between
from viewsep.interfaces import Interpretation, NextView
from viewsep.messages import FloatArray, Phase
from viewsep.models.aspect_graph import AspectGraph
from viewsep.planning.reachable import ReachableViews


@dataclass(frozen=True, slots=True)
class SweepOptions:
    """Settings of the sweep.

    `step_deg` is the length of one movement; no reachable view is further than `apart_deg` from the first sweep's.
    """

    step_deg: Annotated[float, Field(ge=1, le=90)] = 10.0
    apart_deg: Annotated[float, Field(ge=2, le=90)] = 20.0


@dataclass(frozen=True, eq=False, slots=True)
class SweepState:
    """`left` (M, 3) are the views still to visit, `way` (N, 3) the waypoints to the one before them; `sweeps` begun."""

    sweeps: int
    left: FloatArray
    way: FloatArray


class SweepPlanner:
    """Visits well-spread views, the closest one first, then those between at half the distance, and so on.

    Once the poses have converged it is judged at every waypoint.
    """

    options_type = SweepOptions
    state_type = SweepState

    def __init__(
        self, models: Sequence[AspectGraph], reachable: ReachableViews, options: SweepOptions | None = None
    ) -> None:
        self.reachable = reachable
        self.options = options or SweepOptions()

    def start(self, seed: int, view_direction: FloatArray) -> tuple[SweepState, NextView]:
        """A random start view, the same one as the separating-view planner's."""
        directions = self.reachable.directions
        start = directions[np.random.default_rng(seed).integers(len(directions))]
        return SweepState(0, np.empty((0, 3)), np.empty((0, 3))), NextView(start, Phase.STARTING)

    def next_view(
        self, state: SweepState, view_direction: FloatArray, belief: Interpretation | None
    ) -> tuple[SweepState, NextView]:
        """The next waypoint on the way to the view that is next on the sweep."""
        if len(state.way) == 0 and len(state.left) == 0:
            apart_rad = float(np.radians(self.options.apart_deg)) / 2**state.sweeps
            views = sweep(self.reachable.directions, view_direction, apart_rad=apart_rad)
            state = replace(state, sweeps=state.sweeps + 1, left=views[1:])  # it is at the first one
        if len(state.way) == 0:
            way = self.reachable.path(view_direction, state.left[0], float(np.radians(self.options.step_deg)))
            state = replace(state, left=state.left[1:], way=way)
        view, state = state.way[0], replace(state, way=state.way[1:])
        if belief is None or not belief.converged:
            return state, NextView(view, Phase.EXPLORING)
        return state, NextView(view, Phase.APPROACHING, view, arrives=True)


def sweep(reachable: FloatArray, start: FloatArray, looks: int | None = None, apart_rad: float = 0.0) -> FloatArray:
    """(N, 3) views spread evenly over the reachable ones (M, 3), each the closest to the one before.

    Spread by always adding the view farthest from those chosen, from the one closest to `start` (3,) on, until there
    are `looks` of them (None: M) or none is farther than `apart_rad`; two at the least where there are two.
    """
    chosen = [int(np.argmin(angle_between(reachable, start)))]
    gap = angle_between(reachable, reachable[chosen[0]])
    for _ in range(min(len(reachable) if looks is None else looks, len(reachable)) - 1):
        if len(chosen) > 1 and gap.max() <= apart_rad:
            break
        chosen.append(int(np.argmax(gap)))
        gap = np.minimum(gap, angle_between(reachable, reachable[chosen[-1]]))
    left, way = reachable[chosen[1:]], [reachable[chosen[0]]]
    while len(left):
        closest = int(np.argmin(angle_between(left, way[-1])))
        way.append(left[closest])
        left = np.delete(left, closest, axis=0)
    return np.array(way)
