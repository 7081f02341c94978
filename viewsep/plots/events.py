"""What happened in a recorded task, one sentence a row."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from viewsep.account import Account
from viewsep.messages import (
    CancelRequested,
    DeadlinePassed,
    Estimate,
    FrameMissing,
    Phase,
    Result,
    RigFailed,
    Stop,
    TaskStarted,
)
from viewsep.plots.story import Look, Story
from viewsep.plots.telling import seen_from
from viewsep.plots.timeline import axis_of, moves_of

MOST = 1000  # rows; of more the first and the last half


@dataclass(frozen=True, slots=True)
class Happening:
    """`kind` is one of task, move, look, plan, trouble; `words` is a sentence. `at_s` counts from the beginning."""

    at_s: float
    kind: str
    words: str


def happenings(story: Story) -> tuple[list[Happening], int]:
    """What happened in order of time, and how many rows in the middle were left out because there are too many."""
    axis = axis_of(story)
    told = [*_of_looks(story), *_of_plans(story), *_of_messages(story), *_of_moves(story)]
    rows = [
        Happening(axis.seconds(stamp_ns), kind, words) for stamp_ns, kind, words in sorted(told, key=lambda row: row[0])
    ]
    if len(rows) <= MOST:
        return rows, 0
    return rows[: MOST // 2] + rows[-(MOST // 2) :], len(rows) - MOST


def _of_messages(story: Story) -> Iterator[tuple[int, str, str]]:
    noted: set[int] = set()  # the estimate of the last look is published again at the end
    for recorded in story.messages:
        match recorded.message:
            case Estimate(stamp_ns=stamp_ns, note=note) if note and stamp_ns not in noted:
                noted.add(stamp_ns)
                yield stamp_ns, "trouble", f"Out of the ordinary: {note}."
            case TaskStarted(stamp_ns, seed, view):
                yield stamp_ns, "task", f"The task begins with seed {seed}; the camera looks from {seen_from(view)}."
            case FrameMissing(stamp_ns, reason):
                yield stamp_ns, "trouble", f"No usable picture: {reason}"
            case DeadlinePassed(stamp_ns):
                yield stamp_ns, "trouble", "The time for the task is over."
            case CancelRequested(stamp_ns, reason):
                yield stamp_ns, "trouble", f"Somebody asks to end the task: {reason}"
            case RigFailed(stamp_ns, reason):
                yield stamp_ns, "trouble", f"The rig fails: {reason}"
            case Stop():
                yield recorded.stamp_ns, "task", "The rig is told to stop and hold."
            case Result() as result:
                account = Account.of(result)
                ended = f"{account.outcome} {account.object}" if account.object else account.ending
                yield result.stamp_ns, "task", f"Result: {ended}; {account.grounds}."


def _of_moves(story: Story) -> Iterator[tuple[int, str, str]]:
    for move in moves_of(story):
        where = (
            f"Move {move.command.command_id} ({move.command.purpose.value}) to {seen_from(move.command.view_direction)}"
        )
        took = f"after {(move.end_ns - move.begin_ns) / 1e9:.1f} s"
        if move.failure:
            yield move.begin_ns, "trouble", f"{where}: failed {took}: {move.failure}"
        else:
            yield move.begin_ns, "move", f"{where}: {'arrived' if move.arrived else 'given up'} {took}."


def _of_plans(story: Story) -> Iterator[tuple[int, str, str]]:
    for target in story.targets:
        rivals = [model.name for model, rival in zip(story.models, target.belief.plausible, strict=True) if rival]
        words = f"A {story.goal} is chosen, where {' and '.join(rivals)} differ: {seen_from(target.direction)}."
        yield target.stamp_ns, "plan", words
    for stamp_ns, phase in story.course:
        if phase is Phase.JUDGING:
            words = "It waits for a look." if story.by_information else "The separating view is reached."
            yield stamp_ns, "plan", words


def _of_looks(story: Story) -> Iterator[tuple[int, str, str]]:
    judged = {id(look) for look in story.judged}
    before: Look | None = None
    for number, look in enumerate(story.looks, start=1):
        if before is None:
            begin = "" if story.has_probabilities else ": paths begin at every view of every model"
            yield look.percept.stamp_ns, "look", f"Look {number}, the first one{begin}."
        elif look.belief.fresh and not before.belief.fresh:
            yield look.percept.stamp_ns, "look", f"Look {number}: all paths are dropped and begin anew."
        if id(look) in judged:
            yield look.percept.stamp_ns, "look", f"Look {number} is judged: {_standing(story, look)}."
        before = look


def _standing(story: Story, look: Look) -> str:
    """Who leads at a judged look."""
    rated = sorted(look.belief.estimate.candidates, key=lambda candidate: candidate.rating)
    says = f"{rated[0].name} rates best"
    if len(rated) > 1:
        says += f", {rated[1].rating / rated[0].rating:.1f} times better than {rated[1].name}"
    leader, looks = look.leads
    needed = story.config.task.confirming_looks
    return f"{says}; not enough to lead" if leader < 0 else f"{says}; it leads at {looks} of {needed} looks in a row"
