"""How well joints come to rest where they were sent, as their encoders see it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from viewsep.interfaces import Clock, JointLimits, MotionBackend
from viewsep.messages import JointState
from viewsep.moves import move_and_wait

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
    motion: MotionBackend,
    clock: Clock,
    joint: int,
    repeats: int,
    tick: Callable[[], None] = lambda: None,
    watch: Callable[[JointState], None] = lambda state: None,
) -> Repeatability:
    """Approach targets of one joint from both sides, `repeats` times; the other joints stay. Raises RigError.

    `tick` hears of every approach, `watch` of every read-back; it stops by raising.
    """
    rest = motion.read_state().position_rad
    errors: dict[int, list[float]] = {-1: [], 1: []}
    for side, before, there in approaches(motion.limits()[joint], joint, rest, repeats):
        move_and_wait(motion, clock, before, watch)
        commanded, rested = move_and_wait(motion, clock, there, watch)
        errors[side].append(rested.position_rad[joint] - commanded[joint])
        tick()
    move_and_wait(motion, clock, rest, watch)
    below, above = np.array(errors[-1]), np.array(errors[1])
    spread = float(max(below.std(), above.std()))
    worst = float(np.abs([*below, *above]).max())
    return Repeatability(motion.limits()[joint].name, float(below.mean()), float(above.mean()), spread, worst)


def approaches(
    limit: JointLimits, joint: int, rest: Sequence[float], repeats: int
) -> Iterator[tuple[int, list[float], list[float]]]:
    """The side a target is approached from (-1 below, 1 above), where all joints are before, and there."""
    for _ in range(repeats):
        for target in _targets(limit):
            for side in (-1, 1):
                before, there = list(rest), list(rest)
                before[joint], there[joint] = target + side * _reach(limit), target
                yield side, before, there


def _half_range(limit: JointLimits) -> float:
    return float(min(limit.upper_rad - limit.lower_rad, np.pi) / 2)


def _reach(limit: JointLimits) -> float:
    return min(float(REACH_RAD), _half_range(limit) / 2)


def _targets(limit: JointLimits) -> list[float]:
    middle = (limit.lower_rad + limit.upper_rad) / 2 if np.isfinite(limit.upper_rad - limit.lower_rad) else 0.0
    return [middle + share * _half_range(limit) for share in TARGETS]
