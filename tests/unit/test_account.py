"""How a task ended, in words: one sentence for every outcome, and the pose where there is one."""

from __future__ import annotations

import numpy as np
import pytest

from viewsep.account import Account, either, percent, view_in_words
from viewsep.geometry import spherical_direction
from viewsep.messages import Outcome, Result

BELOW = spherical_direction(np.radians(90.0), np.radians(-85.0))


def result(outcome: Outcome, named: str = "", reason: str = "why", **more: object) -> Result:
    return Result(9, outcome, named, reason, (), np.eye(3), 3, 0.1, 9, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("told", "ending", "sentence"),
    [
        (result(Outcome.IDENTIFIED, "tea"), "identified as tea", "It is tea: why."),
        (
            result(Outcome.UNKNOWN, reason="its probability is 0.9990 after 14 looks"),
            "unknown, none of the candidates",
            "It is none of the candidates: its probability is 0.9990 after 14 looks.",
        ),
        (
            result(Outcome.INDISTINGUISHABLE, indistinct=("tea", "decaf")),
            "indistinguishable, tea or decaf",
            "It is tea or decaf: why.",
        ),
        (
            result(Outcome.INDISTINGUISHABLE, reason="no view", indistinct=("tea", "decaf"), telling_view=BELOW),
            "indistinguishable, tea or decaf",
            "It is tea or decaf: no view; azimuth 90°, elevation -85° would, which it cannot reach.",
        ),
        (result(Outcome.UNDECIDED), "undecided", "undecided: why."),
        (result(Outcome.FAILED), "failed", "failed: why."),
    ],
)
def test_every_outcome_has_its_sentence(told: Result, ending: str, sentence: str) -> None:
    account = Account.of(told)
    assert (account.ending, account.sentence) == (ending, sentence)


def test_no_outcome_is_left_out() -> None:
    assert {outcome for outcome in Outcome if Account.of(result(outcome, "x", indistinct=("x",))).ending} == set(
        Outcome
    )


def test_an_outcome_of_a_newer_version_is_said_as_it_is() -> None:
    assert Account("of_the_future", "", "why").sentence == "of_the_future: why."


@pytest.mark.parametrize(
    ("outcome", "spread_deg", "words"),
    [
        (Outcome.IDENTIFIED, 4.2, "pose known to ±4°"),
        (Outcome.IDENTIFIED, 0.26, "pose known to ±0.3°"),
        (Outcome.INDISTINGUISHABLE, 12.0, "pose known to ±12°"),
        (Outcome.IDENTIFIED, None, ""),
        (Outcome.IDENTIFIED, np.inf, ""),
        (Outcome.UNKNOWN, 4.2, ""),
        (Outcome.UNDECIDED, 4.2, ""),
    ],
)
def test_the_pose_is_said_of_what_has_one(outcome: Outcome, spread_deg: float | None, words: str) -> None:
    spread_rad = None if spread_deg is None else float(np.radians(spread_deg))
    assert Account.of(result(outcome, "tea", indistinct=("tea", "decaf"), pose_spread_rad=spread_rad)).pose == words


def test_names_are_strung_together() -> None:
    assert [either(names) for names in ((), ("a",), ("a", "b"), ("a", "b", "c"))] == ["", "a", "a or b", "a, b or c"]


def test_views_are_whole_degrees_without_a_negative_zero() -> None:
    assert view_in_words(-0.3, 89.6) == "azimuth 0°, elevation 90°"


def test_only_what_is_certain_is_0_or_100_percent() -> None:
    said = [percent(p) for p in (0.0, 1e-9, 0.0006, 0.5, 0.9994, 0.99999, 1.0)]
    assert said == ["0.0 %", "< 0.1 %", "0.1 %", "50.0 %", "99.9 %", "> 99.9 %", "100.0 %"]
