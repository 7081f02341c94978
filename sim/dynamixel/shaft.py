"""What turns: the motor's shaft with its history, and the joint behind the gear's play.

Positions in encoder counts, not wrapped; the count 0 is the encoder's.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from dataclasses import dataclass

from viewsep.sim.dynamixel.profile import Motion, rest

HISTORY_S = 30.0


@dataclass(frozen=True, slots=True)
class Stretch:
    """One command's motion, up to where something is in the way."""

    start_ns: int
    motion: Motion
    blocked_s: float  # from when on it stands still though it is driven; infinite: never
    joint: float  # where the joint is at the start
    play: float

    def seconds(self, stamp_ns: int) -> float:
        """Time since the start."""
        return (stamp_ns - self.start_ns) * 1e-9

    def position(self, stamp_ns: int) -> float:
        """Where the motor's shaft is."""
        return self.motion.position_at(min(self.seconds(stamp_ns), self.blocked_s))

    def velocity(self, stamp_ns: int) -> float:
        """Counts per second of the motor's shaft."""
        seconds = self.seconds(stamp_ns)
        return 0.0 if seconds >= self.blocked_s else self.motion.velocity_at(seconds)

    def joint_position(self, stamp_ns: int) -> float:
        """Where the joint is: it follows when the play is taken up. No phase changes direction, so this is exact."""
        seconds = min(self.seconds(stamp_ns), self.blocked_s)
        joint = self._dragged(self.joint, self.motion.position_at(0.0))
        for phase in self.motion.phases:
            if phase.start_s >= seconds:
                break
            joint = self._dragged(joint, phase.position_at(min(seconds, phase.end_s)))
        return self._dragged(joint, self.motion.position_at(seconds))

    def _dragged(self, joint: float, shaft: float) -> float:
        return min(max(joint, shaft - self.play / 2), shaft + self.play / 2)


class Shaft:
    """Past, present and planned motion of one servo. Times in nanoseconds of whatever clock the caller has."""

    def __init__(self, position: float, play: float, start_ns: int) -> None:
        self.stops = (-math.inf, math.inf)
        self.stuck = False
        self.play = play
        self._stretches = [Stretch(start_ns, rest(position), math.inf, position, play)]

    @property
    def now(self) -> Stretch:
        """The command in force."""
        return self._stretches[-1]

    def at(self, stamp_ns: int) -> Stretch:
        """The stretch that held at a time; before all history the first one."""
        index = bisect_right(self._stretches, stamp_ns, key=lambda stretch: stretch.start_ns)
        return self._stretches[max(0, index - 1)]

    def follow(self, stamp_ns: int, motion: Motion, *, held: bool = False) -> None:
        """Begin another motion. `held`: it cannot move at all."""
        joint = self.now.joint_position(stamp_ns)
        blocked_s = 0.0 if self.stuck or held else self._blocked_s(motion)
        self._append(Stretch(stamp_ns, motion, blocked_s, joint, self.play))

    def turn(self, stamp_ns: int, counts: float, *, free: bool) -> None:
        """Somebody turns the joint; the motor's shaft comes along if it is free, else only the play gives way."""
        if not free and self.now.velocity(stamp_ns):
            return
        shaft, joint = self.now.position(stamp_ns), self.now.joint_position(stamp_ns) + counts
        if free:
            lower, upper = self.stops
            shaft = min(max(shaft, joint - self.play / 2), joint + self.play / 2)
            shaft = min(max(shaft, lower), upper)
        joint = min(max(joint, shaft - self.play / 2), shaft + self.play / 2)
        self._append(Stretch(stamp_ns, rest(shaft), math.inf, joint, self.play))

    def place(self, stamp_ns: int, position: float) -> None:
        """Be somewhere else at once."""
        self._append(Stretch(stamp_ns, rest(position), math.inf, position, self.play))

    def _blocked_s(self, motion: Motion) -> float:
        lower, upper = self.stops
        return min(motion.passing(upper, upwards=True), motion.passing(lower, upwards=False))

    def _append(self, stretch: Stretch) -> None:
        while len(self._stretches) > 1 and self._stretches[1].start_ns < stretch.start_ns - HISTORY_S * 1e9:
            del self._stretches[0]
        self._stretches.append(stretch)
