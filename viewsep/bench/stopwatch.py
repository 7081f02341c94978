"""An engine with a stopwatch: how long the steps take that interpret a percept."""

from __future__ import annotations

from time import perf_counter, thread_time

from viewsep.engine.engine import Engine
from viewsep.engine.state import EngineState
from viewsep.messages import Command, Event, PerceptReceived


class TimedEngine(Engine):
    """Does what `engine` does; `wall_s` and `cpu_s` grow by one time for every look that was interpreted."""

    def __init__(self, engine: Engine) -> None:
        super().__init__(engine.interpreter, engine.planner, engine.limits, engine.reachable)
        self.wall_s: list[float] = []
        self.cpu_s: list[float] = []

    def step(self, state: EngineState, event: Event) -> tuple[EngineState, tuple[Command, ...]]:
        """One step of the engine."""
        wall, cpu = perf_counter(), thread_time()
        after = super().step(state, event)
        if isinstance(event, PerceptReceived) and after[0].looks > state.looks:
            self.wall_s.append(perf_counter() - wall)
            self.cpu_s.append(thread_time() - cpu)
        return after
