"""Random motion: the baseline that every planner has to beat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from viewsep.interfaces import Interpretation, NextView
from viewsep.messages import FloatArray, Phase
from viewsep.models.aspect_graph import AspectGraph
from viewsep.planning.reachable import ReachableViews


@dataclass(frozen=True, slots=True)
class RandomOptions:
    """`step_deg` is the length of one movement on the way to a random view."""

    step_deg: Annotated[float, Field(ge=1, le=90)] = 10.0


@dataclass(frozen=True, eq=False, slots=True)
class RandomState:
    """`way` (N, 3) are the waypoints still to drive to; `drawn` counts the targets, `seed` decides them."""

    seed: int
    drawn: int
    way: FloatArray


class RandomPlanner:
    """Drives to one random reachable view after the other; once the poses have converged it is judged at each."""

    options_type = RandomOptions
    state_type = RandomState

    def __init__(
        self, models: Sequence[AspectGraph], reachable: ReachableViews, options: RandomOptions | None = None
    ) -> None:
        self.reachable = reachable
        self.options = options or RandomOptions()

    def start(self, seed: int, view_direction: FloatArray) -> tuple[RandomState, NextView]:
        """A random start view, the same one as the separating-view planner's."""
        start = self._draw(np.random.default_rng(seed))
        return RandomState(seed, 0, np.empty((0, 3))), NextView(start, Phase.STARTING)

    def next_view(
        self, state: RandomState, view_direction: FloatArray, belief: Interpretation | None
    ) -> tuple[RandomState, NextView]:
        """The next waypoint to the random view that is the target now."""
        if len(state.way) == 0:
            target = self._draw(np.random.default_rng([state.seed, 3, state.drawn]))
            way = self.reachable.path(view_direction, target, float(np.radians(self.options.step_deg)))
            state = replace(state, drawn=state.drawn + 1, way=way)
        view, state = state.way[0], replace(state, way=state.way[1:])
        if belief is None or not belief.converged:
            return state, NextView(view, Phase.EXPLORING)
        return state, NextView(view, Phase.APPROACHING, view, arrives=True)

    def _draw(self, rng: np.random.Generator) -> FloatArray:
        drawn: FloatArray = self.reachable.directions[rng.integers(len(self.reachable.directions))]
        return drawn
