"""How a method did over many recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from viewsep.recordings.what_if import Course, Ending


@dataclass(frozen=True, slots=True)
class Tally:
    """How many recordings a method ended how in. `unchecked` are named objects where the truth is not known; `unknown`
    and `indistinguishable` are counted by themselves, whatever the truth is, since they name nothing.

    `agree` and `differ` compare with the recorded decision where both decided. The medians, nan without any, are over
    the courses that named an object: looks and travel on the view sphere up to there.
    """

    right: int
    wrong: int
    unchecked: int
    unknown: int
    indistinguishable: int
    undecided: int
    failed: int
    recording_ends: int
    agree: int
    differ: int
    looks_median: float
    travel_median_rad: float


def is_right(course: Course, truth: str) -> bool | None:
    """Whether the object was named rightly; None where none was named or the truth (empty) is not known."""
    return course.object == truth if course.object and truth else None


def tally(courses: Sequence[Course], recorded: Sequence[Course], truths: Sequence[str]) -> Tally:
    """Count the courses of one method, one a recording."""
    answers = [is_right(course, truth) for course, truth in zip(courses, truths, strict=True)]
    named = [course for course in courses if course.ending is Ending.IDENTIFIED]
    endings = [course.ending for course in courses]
    agreements = [course.agrees(other) for course, other in zip(courses, recorded, strict=True)]
    return Tally(
        right=answers.count(True),
        wrong=answers.count(False),
        unchecked=len(named) - answers.count(True) - answers.count(False),
        unknown=endings.count(Ending.UNKNOWN),
        indistinguishable=endings.count(Ending.INDISTINGUISHABLE),
        undecided=endings.count(Ending.UNDECIDED),
        failed=endings.count(Ending.FAILED),
        recording_ends=endings.count(Ending.RECORDING_ENDS),
        agree=agreements.count(True),
        differ=agreements.count(False),
        looks_median=median(course.looks for course in named) if named else float("nan"),
        travel_median_rad=median(course.travel_rad for course in named) if named else float("nan"),
    )
