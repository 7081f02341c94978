"""Profiles of a move as functions of time: nothing depends on how often they are asked.

Positions in encoder counts, times in seconds from the move's start.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Phase:
    """Constant acceleration. The direction of motion never changes within a phase."""

    start_s: float
    duration_s: float  # may be infinite
    position: float
    velocity: float
    acceleration: float

    def position_at(self, time_s: float) -> float:
        """Position; after the end the last one."""
        t = min(max(time_s - self.start_s, 0.0), self.duration_s)
        return self.position + self.velocity * t + 0.5 * self.acceleration * t * t

    def velocity_at(self, time_s: float) -> float:
        """Velocity within the phase."""
        return self.velocity + self.acceleration * min(max(time_s - self.start_s, 0.0), self.duration_s)

    @property
    def end_s(self) -> float:
        """When the next phase begins."""
        return self.start_s + self.duration_s


@dataclass(frozen=True, slots=True)
class Motion:
    """Phases one after the other, then rest at `goal`."""

    phases: tuple[Phase, ...]
    goal: float

    @property
    def end_s(self) -> float:
        """When it comes to rest: infinite for one that never does."""
        return self.phases[-1].end_s if self.phases else 0.0

    def position_at(self, time_s: float) -> float:
        """Counts at a time."""
        for phase in self.phases:
            if time_s < phase.end_s:
                return phase.position_at(time_s)
        return self.goal

    def velocity_at(self, time_s: float) -> float:
        """Counts per second at a time."""
        for phase in self.phases:
            if time_s < phase.end_s:
                return phase.velocity_at(time_s)
        return 0.0

    def passing(self, level: float, upwards: bool) -> float:
        """The first time at which it goes beyond `level` in a direction; infinite if it does not."""
        sign = 1.0 if upwards else -1.0
        for phase in self.phases:
            last = phase.position_at(phase.end_s) if phase.duration_s < math.inf else phase.velocity * math.inf
            if sign * (last - level) > 1e-6 and sign * (last - phase.position) > 0.0:
                return phase.start_s + _time_to(phase, level, sign)
        return math.inf


def _time_to(phase: Phase, level: float, sign: float) -> float:
    distance = level - phase.position
    if sign * distance <= 0.0:
        return 0.0
    last = sign * math.sqrt(max(0.0, phase.velocity**2 + 2.0 * phase.acceleration * distance))
    return 2.0 * distance / (phase.velocity + last)


def rest(position: float) -> Motion:
    """No motion at all."""
    return Motion((), position)


def move(position: float, velocity: float, goal: float, speed: float, acceleration: float) -> Motion:
    """From any state to rest at `goal` in the shortest time with `speed` and `acceleration` (infinite: at once)."""
    if math.isinf(acceleration):
        duration = abs(goal - position) / speed
        cruise = Phase(0.0, duration, position, math.copysign(speed, goal - position), 0.0)
        return Motion((cruise,) if duration > 0.0 else (), goal)
    braked = position + velocity * abs(velocity) / (2.0 * acceleration)
    sign = math.copysign(1.0, goal - braked)
    distance, forward = sign * (goal - position), sign * velocity  # negative: it goes the wrong way and has to turn
    top = min(speed, math.sqrt(max(0.0, distance * acceleration + 0.5 * velocity**2)))
    if forward > speed:
        top = speed
    ramps = [(forward, 0.0), (0.0, top)] if forward < 0.0 else [(forward, top)]
    covered = sum(_distance(a, b, acceleration) for a, b in [*ramps, (top, 0.0)])
    cruise_s = (distance - covered) / top if top > 0.0 else 0.0
    phases = _ramp(position, [(sign * a, sign * b) for a, b in ramps], acceleration)
    if cruise_s > 0.0:
        phases.append(Phase(_end(phases), cruise_s, _last(phases, position), sign * top, 0.0))
    phases += _ramp(_last(phases, position), [(sign * top, 0.0)], acceleration, _end(phases))
    return Motion(tuple(phases), goal)


def _distance(before: float, after: float, acceleration: float) -> float:
    return 0.5 * (before + after) * abs(after - before) / acceleration


def _ramp(position: float, ramps: list[tuple[float, float]], acceleration: float, start_s: float = 0.0) -> list[Phase]:
    """Phases from velocity to velocity."""
    phases: list[Phase] = []
    for before, after in ramps:
        if before != after:
            rate = math.copysign(acceleration, after - before)
            phases.append(Phase(start_s, (after - before) / rate, position, before, rate))
            start_s, position = phases[-1].end_s, _last(phases, position)
    return phases


def _end(phases: list[Phase]) -> float:
    return phases[-1].end_s if phases else 0.0


def _last(phases: list[Phase], position: float) -> float:
    return phases[-1].position_at(math.inf) if phases else position


def run(position: float, velocity: float, speed: float, acceleration: float) -> Motion:
    """From any state to a constant velocity, kept for ever."""
    phases: list[Phase] = []
    if not math.isinf(acceleration):
        turning = velocity * speed < 0.0
        ramps = [(velocity, 0.0), (0.0, speed)] if turning else [(velocity, speed)]
        phases = _ramp(position, ramps, acceleration)
    goal = _last(phases, position)
    if speed != 0.0:
        phases.append(Phase(_end(phases), math.inf, goal, speed, 0.0))
    return Motion(tuple(phases), goal)
