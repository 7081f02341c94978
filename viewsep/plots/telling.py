"""A story in sentences: what was decided, how sure that is, and why it could not be told otherwise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from viewsep.account import NONE_OF_THEM, Account, percent, view_in_words
from viewsep.config import Config, geometry_of
from viewsep.geometry import azimuth_elevation
from viewsep.interpretation.interpreter import PathInterpreter
from viewsep.messages import CancelRequested, FloatArray, Outcome, Phase, Result
from viewsep.plots.story import Story
from viewsep.servo_rig import is_emulated

MOST_PROBABLE = 5  # candidates whose probabilities are told


@dataclass(frozen=True, slots=True)
class Decision:
    """`kind` is one of right, wrong, named, undecided, failed, open, `named` for any answer that cannot be judged and
    `undecided` where candidates remain; `badge` says it in a few words.

    The sentence is `before`, the `name` of the object (empty where none was named), `after`; `reasons` are sentences.
    """

    kind: str
    badge: str
    before: str
    name: str
    after: str
    reasons: list[str]

    @property
    def sentence(self) -> str:
        """All of it."""
        return f"{self.before}{self.name}{self.after}"


def decide(story: Story) -> Decision:
    """What the task came to."""
    result = story.result
    was = f" It was {story.truth}." if story.truth else ""
    if result is None:
        reasons = ["The recording ends before the task does.", *_how_close(story)]
        return Decision("open", "No result", f"There is no answer.{was}", "", "", reasons)
    account = Account.of(result)
    reasons = [_sentence(account.grounds), *([f"{account.pose.capitalize()}."] if account.pose else [])]
    if result.outcome is Outcome.IDENTIFIED:
        reasons += [f"To be named, a candidate must rate {_rule(story)}."] if _rule(story) else []
        if story.correct:
            return Decision("right", "Identified, right", "It is ", result.object, ", and that is right.", reasons)
        if story.correct is False:
            after = f", and that is wrong: it was {story.truth}."
            return Decision("wrong", "Identified, wrong", "It was taken for ", result.object, after, reasons)
        return Decision("named", "Identified, truth not recorded", "It is ", result.object, ".", reasons)
    reasons += _how_close(story)
    if result.outcome in (Outcome.UNKNOWN, Outcome.INDISTINGUISHABLE):
        return _without_a_name(story, account, reasons)
    if result.outcome is Outcome.UNDECIDED:
        return Decision("undecided", "Undecided", f"It could not be told which object this is.{was}", "", "", reasons)
    if any(isinstance(recorded.message, CancelRequested) for recorded in story.messages):
        return Decision(
            "failed", "Cancelled", f"The task was cancelled before there was an answer.{was}", "", "", reasons
        )
    return Decision("failed", "Failed", f"The task failed before there was an answer.{was}", "", "", reasons)


def _without_a_name(story: Story, account: Account, reasons: list[str]) -> Decision:
    """It is none of the candidates, or one of several."""
    outcome = account.outcome.capitalize()
    if story.correct is False:
        before = f"It was taken for {account.answer}, and that is wrong: it was {story.truth}."
        return Decision("wrong", f"{outcome}, wrong", before, "", "", reasons)
    if account.outcome == Outcome.INDISTINGUISHABLE:
        before = f"It is {account.answer}: which of them, no view that this rig can show tells."
        was = f" It was {story.truth}." if story.truth else ""
        return Decision("undecided", outcome, f"{before}{was}", "", "", reasons)
    if story.correct:
        before = f"It is {account.answer}, and that is right: it was {story.truth}."
        return Decision("right", f"{outcome}, right", before, "", "", reasons)
    return Decision("named", f"{outcome}, truth not recorded", f"It is {account.answer}.", "", "", reasons)


def outcome_in_words(result: Result | None) -> str:
    """A result in a few words, to compare a recording with its replay."""
    if result is None:
        return "no result"
    if result.object:
        return f"{result.outcome.value} {result.object} after {result.looks} looks"
    return f"{Account.of(result).ending} after {result.looks} looks"


def final_ratings(story: Story) -> list[tuple[str, float, float]]:
    """Name, rating and how many times the best one's it is, of every candidate at the end, best first."""
    if not story.looks:
        return []
    last = story.looks[-1].belief.estimate.candidates
    best = last[story.ranking[0]].rating
    return [(last[k].name, last[k].rating, last[k].rating / best) for k in story.ranking]


def final_probabilities(story: Story) -> list[tuple[str, float]]:
    """Name and probability of every candidate at the end, best first, then of none of them; empty without any."""
    if not story.has_probabilities:
        return []
    last = story.looks[-1].belief.estimate
    rated = [(last.candidates[k].name, last.candidates[k].probability or 0.0) for k in story.ranking]
    return rated if last.unknown is None else [*rated, (NONE_OF_THEM, last.unknown)]


def factor_of(story: Story) -> float | None:
    """How many times better the best candidate must be to be named; None where the interpreter has no such rule."""
    return story.interpreter.options.plausible_within if isinstance(story.interpreter, PathInterpreter) else None


def rig_in_words(config: Config) -> tuple[str, str]:
    """The rig's name, and what of it is simulated."""
    name, backend = geometry_of(config.rig).name, config.rig.backend
    if backend == "photos":
        return name, "simulated plate over real photos"
    if backend == "dynamixel":
        moves = "emulated servos" if is_emulated(config) else f"servos on {config.dynamixel.port}"
        return name, f"{moves}, simulated camera"
    return name, "simulated rig, not a real one"


def seen_from(direction: FloatArray) -> str:
    """A view direction (3,) in degrees."""
    azimuth, elevation = np.degrees(azimuth_elevation(direction)).tolist()
    return view_in_words(azimuth, elevation)


def counted(number: int, thing: str) -> str:
    """`1 look`, `2 looks`."""
    return f"{number} {thing}{'' if number == 1 else 's'}"


def _how_close(story: Story) -> list[str]:
    """How far the candidates were from a decision, and what was missing."""
    rated, probable = final_ratings(story), final_probabilities(story)
    if not rated:
        return ["No view was interpreted."]
    if probable:
        first = sorted(probable, key=lambda said: -said[1])[:MOST_PROBABLE]
        said = ", ".join(f"{name} {percent(probability)}".replace(" %", "\u00a0%") for name, probability in first)
        return [f"How probable they were at the end: {said}{', the others less' * (len(probable) > len(first))}."]
    said = f"At the end {rated[0][0]} rated best ({rated[0][1]:.3g})"
    if len(rated) > 1:
        said += f", {rated[1][0]} next ({rated[1][1]:.3g}), {rated[1][2]:.1f} times as much"
    rule = _rule(story)
    reasons = [f"{said}; to be named, a candidate must rate {rule}." if rule else f"{said}."]
    longest = max((looks for _, looks in (look.leads for look in story.judged if look.leads[0] >= 0)), default=0)
    if not any(phase is Phase.JUDGING for _, phase in story.course):
        return [*reasons, "No separating view was reached."]
    if longest == 0:
        return [*reasons, "Near the separating views nobody was that far ahead."]
    return [*reasons, f"Near the separating views nobody was that far ahead at more than {counted(longest, 'look')}."]


def _rule(story: Story) -> str:
    factor, task = factor_of(story), story.config.task
    if factor is None:
        return ""
    looks = f"{task.confirming_looks} looks in a row" if task.confirming_looks > 1 else "a look"
    return f"{factor:g} times better than every other at {looks} within {task.judge_within_deg:g}° of a separating view"


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}" + ("" if text.endswith((".", "!", "?")) else ".")
