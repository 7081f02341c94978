"""How well joints come to rest where they were sent, as their encoders see it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from viewsep.errors import RigError, Timeout
from viewsep.interfaces import Clock, JointLimits, MotionBackend

POLL_NS = 20_000_000
ARRIVE_S = 60.0
REACH_RAD = np.radians(20.0)  # how far to each side a target is approached from
TARGETS = (-0.3, 0.0, 0.3)  # of half the range


@dataclass(frozen=True, slots=True)
class Repeatability:
    """Errors of one joint at rest, radians: mean when coming from below and from above, and their spread.

    The difference of the two is the dead band of servo and gear before the encoder. Play behind the encoder does not
    show here; only a camera sees it.
    """

    joint: str
    below_rad: float
    above_rad: float
    spread_rad: float
    worst_rad: float

    @property
    def dead_band_rad(self) -> float:
        """Between coming from below and from above."""
        return abs(self.above_rad - self.below_rad)


def measure(
    motion: MotionBackend, clock: Clock, joint: int, repeats: int, tick: Callable[[], None] = lambda: None
) -> Repeatability:
    """Approach targets of one joint from both sides, `repeats` times; the other joints stay. Raises RigError."""
    limit = motion.limits()[joint]
    rest = list(motion.read_state().position_rad)
    errors: dict[int, list[float]] = {-1: [], 1: []}
    for _ in range(repeats):
        for target in _targets(limit):
            for side in (-1, 1):
                before, there = list(rest), list(rest)
                before[joint], there[joint] = target + side * _reach(limit), target
                _arrive(motion, clock, before)
                commanded = _arrive(motion, clock, there)
                errors[side].append(motion.read_state().position_rad[joint] - commanded[joint])
                tick()
    _arrive(motion, clock, rest)
    below, above = np.array(errors[-1]), np.array(errors[1])
    spread = float(max(below.std(), above.std()))
    worst = float(np.abs([*below, *above]).max())
    return Repeatability(limit.name, float(below.mean()), float(above.mean()), spread, worst)


def _half_range(limit: JointLimits) -> float:
    return float(min(limit.upper_rad - limit.lower_rad, np.pi) / 2)


def _reach(limit: JointLimits) -> float:
    return min(float(REACH_RAD), _half_range(limit) / 2)


def _targets(limit: JointLimits) -> list[float]:
    middle = (limit.lower_rad + limit.upper_rad) / 2 if np.isfinite(limit.upper_rad - limit.lower_rad) else 0.0
    return [middle + share * _half_range(limit) for share in TARGETS]


def _arrive(motion: MotionBackend, clock: Clock, goal: Sequence[float]) -> tuple[float, ...]:
    """Move and wait until all stands still. Raises RigError, Timeout."""
    commanded = motion.move_to(goal)
    until_ns = clock.now_ns() + round(ARRIVE_S * 1e9)
    while motion.read_state().moving:
        if fault := motion.fault():
            raise RigError(fault)
        if clock.now_ns() > until_ns:
            raise Timeout(f"the joints did not come to rest within {ARRIVE_S:g} s")
        clock.sleep_until(clock.now_ns() + POLL_NS)
    return commanded
