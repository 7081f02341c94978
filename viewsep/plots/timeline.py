"""When things happened: phases, moves, looks and troubles of a task on one axis of time."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from viewsep.messages import (
    CancelRequested,
    DeadlinePassed,
    FrameMissing,
    MoveFailed,
    MoveSettled,
    MoveTo,
    Phase,
    RigFailed,
    Stop,
)
from viewsep.plots.story import Story
from viewsep.plots.telling import seen_from

TICKS = 6  # at most, about
NARROWEST = 0.15  # per cent of the width that anything is drawn with


@dataclass(frozen=True, eq=False, slots=True)
class Move:
    """A commanded move; `failure` says why it failed, `arrived` whether it did. Without either it was given up."""

    command: MoveTo
    begin_ns: int
    end_ns: int
    arrived: bool
    failure: str


@dataclass(frozen=True, slots=True)
class Span:
    """Something between two moments, as per cent of the time; `kind` chooses the colour, `words` say what it is."""

    left: float
    width: float
    kind: str
    words: str


@dataclass(frozen=True, slots=True)
class Row:
    """A line of the timeline; `wide` ones have spans with an extent, the others marks at moments."""

    name: str
    spans: list[Span]
    wide: bool


@dataclass(frozen=True, slots=True)
class Axis:
    """The time from the task's beginning to the end of the recording."""

    begin_ns: int
    end_ns: int

    def seconds(self, stamp_ns: int) -> float:
        """Since the beginning."""
        return (stamp_ns - self.begin_ns) / 1e9

    def percent(self, stamp_ns: int) -> float:
        """Where a moment lies, 0 to 100."""
        share = (stamp_ns - self.begin_ns) / max(1, self.end_ns - self.begin_ns)
        return round(100.0 * min(max(share, 0.0), 1.0), 3)

    def ticks(self) -> list[tuple[float, str]]:
        """Per cent and label of round numbers of seconds."""
        duration = self.seconds(self.end_ns)
        if duration <= 0.0:
            return [(0.0, "0 s")]
        rough = duration / TICKS
        power = 10.0 ** np.floor(np.log10(rough))
        step = float(power * next(factor for factor in (1, 2, 5, 10) if factor * power >= rough))
        numbers = range(int(duration / step + 1e-9) + 1)
        return [(round(100.0 * i * step / duration, 3), f"{i * step:g} s") for i in numbers]


def axis_of(story: Story) -> Axis:
    """The axis of everything that was heard since the task began."""
    stamps = [recorded.stamp_ns for recorded in story.messages]
    return Axis(min(stamps, default=0), max(stamps, default=0))


def moves_of(story: Story) -> list[Move]:
    """Every move with how it ended. One without an end lasted until the next command or the end of the recording."""
    moves: list[Move] = []
    going: tuple[MoveTo, int] | None = None

    def close(end_ns: int, *, arrived: bool = False, failure: str = "") -> None:
        nonlocal going
        if going is not None:
            moves.append(Move(*going, end_ns, arrived, failure))
        going = None

    for recorded in story.messages:
        match recorded.message:
            case MoveTo() as command:
                close(recorded.stamp_ns)
                going = command, recorded.stamp_ns
            case Stop():
                close(recorded.stamp_ns)
            case MoveSettled(stamp_ns, command_id) if going and going[0].command_id == command_id:
                close(stamp_ns, arrived=True)
            case MoveFailed(stamp_ns, command_id, reason) if going and going[0].command_id == command_id:
                close(stamp_ns, failure=reason)
    close(axis_of(story).end_ns)
    return moves


def rows_of(story: Story) -> list[Row]:
    """Phases, looks, moves, failed moves, missing frames and stops, also those that have nothing to show."""
    axis = axis_of(story)

    def span(begin_ns: int, end_ns: int, kind: str, words: str) -> Span:
        width = max(NARROWEST, axis.percent(end_ns) - axis.percent(begin_ns))
        left = min(axis.percent(begin_ns), 100.0 - width)
        lasted = f" to {axis.seconds(end_ns):.1f}" if end_ns > begin_ns else ""
        return Span(round(left, 3), round(width, 3), kind, f"{words}, {axis.seconds(begin_ns):.1f}{lasted} s")

    def moment(stamp_ns: int, kind: str, words: str) -> Span:
        return span(stamp_ns, stamp_ns, kind, words)

    phases = [
        span(begin_ns, end_ns, phase.value, phase.value)
        for (begin_ns, phase), (end_ns, _) in pairwise([*story.course, (axis.end_ns, Phase.DONE)])
        if phase not in (Phase.IDLE, Phase.DONE)
    ]
    looks = [
        moment(look.percept.stamp_ns, look.phase.value, f"look {i}") for i, look in enumerate(story.looks, start=1)
    ]
    went, failed = [], []
    for move in moves_of(story):
        words = f"move {move.command.command_id} to {seen_from(move.command.view_direction)}"
        if move.failure:
            failed.append(span(move.begin_ns, move.end_ns, "failed", f"{words} failed: {move.failure}"))
        else:
            went.append(span(move.begin_ns, move.end_ns, "move", words))
    missing, stops = [], []
    for recorded in story.messages:
        match recorded.message:
            case FrameMissing(stamp_ns, reason):
                missing.append(moment(stamp_ns, "missing", reason))
            case Stop(_, reason):
                stops.append(moment(recorded.stamp_ns, "stop", f"the rig was stopped: {reason}"))
            case CancelRequested(stamp_ns, reason) | RigFailed(stamp_ns, reason):
                stops.append(moment(stamp_ns, "stop", reason))
            case DeadlinePassed(stamp_ns):
                stops.append(moment(stamp_ns, "stop", "the time for the task was over"))
    return [
        Row("Phases", phases, wide=True),
        Row(f"Looks: {len(looks)}", looks, wide=False),
        Row(f"Moves: {len(went)}", went, wide=True),
        Row(f"Failed moves: {len(failed)}", failed, wide=True),
        Row(f"Missing frames: {len(missing)}", missing, wide=False),
        Row(f"Stops: {len(stops)}", stops, wide=False),
    ]
