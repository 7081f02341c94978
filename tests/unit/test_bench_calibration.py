"""Probabilities beside what is true: the figures on cases that can be worked out by hand, and the command."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shell import Shell

from viewsep.bench.calibration import decision_of
from viewsep.bench.journal import Row
from viewsep.bench.reliability import calibration_summary, equal_count, equal_width, looks_of
from viewsep.bench.report import Report
from viewsep.bench.summary import verdict, wilson95
from viewsep.plots.calibration import draw_calibration


def told(index: int, truth: str, probabilities: list[list[float]], method: str = "filter") -> Row:
    """A task with the candidates a and b; another truth is unknown. A look is [a, b, none]."""
    known, names = truth in "ab", ["a", "b"]
    decision = decision_of(np.array(probabilities), names)
    outcome = "undecided" if decision is None else "identified" if decision.named else "unknown"
    named = decision.named if decision else ""
    return {
        "index": index,
        "seed": index,
        "method": method,
        "truth": truth,
        "known": known,
        "identical": False,
        "candidates": names,
        "outcome": outcome,
        "object": named,
        "verdict": verdict(outcome, named, truth, known),
        "looks": len(probabilities),
        "probabilities": probabilities,
        "unknown_probability": probabilities[-1][-1],
        "decision": None if decision is None else {"look": decision.look, "probability": decision.probability},
    }


ROWS = [
    told(0, "a", [[0.6, 0.35, 0.05], [0.92, 0.06, 0.02], [0.995, 0.004, 0.001]]),
    told(1, "b", [[0.64, 0.31, 0.05], [0.991, 0.008, 0.001], [0.3, 0.69, 0.01]]),  # named wrongly, then better
    told(2, "c", [[0.5, 0.3, 0.2], [0.2, 0.15, 0.65], [0.003, 0.003, 0.994]]),
]


def test_the_calibration_error_is_that_of_the_textbook() -> None:
    found = calibration_summary(ROWS)
    # the leaders by bins: 0.5 (0 right), 0.6 and 0.64 and 0.69 and 0.65 (3), 0.92 and 0.995 and 0.991 and 0.994 (3)
    gaps = [0.5 - 0, 0.6 + 0.64 + 0.69 + 0.65 - 3, 0.92 + 0.995 + 0.991 + 0.994 - 3]
    assert found["ece"] == pytest.approx(sum(map(abs, gaps)) / 9)
    assert [each["n"] for each in found["reliability"]["leader"]["equal_width"]] == [1, 4, 4]
    last = found["reliability"]["leader"]["equal_width"][-1]
    assert (last["lowest"], last["highest"], last["observed"]) == (0.92, 0.995, 0.75)
    assert last["wilson95"] == wilson95(3, 4)
    assert found["looks"] == 9
    assert sum(each["n"] for each in found["reliability"]["every"]["equal_width"]) == 27


def test_scores_are_means_over_the_looks() -> None:
    found = calibration_summary(ROWS)
    truth = np.array([[1, 0, 0]] * 3 + [[0, 1, 0]] * 3 + [[0, 0, 1]] * 3)
    p = np.concatenate([row["probabilities"] for row in ROWS])
    assert found["brier"] == pytest.approx(((p - truth) ** 2).sum() / 9)
    assert found["log_loss"] == pytest.approx(-np.log((p * truth).sum(axis=1)).mean())
    for key in ("ece", "ece_every", "brier", "log_loss"):
        low, high = found[f"{key}_bootstrap95"]
        assert low < high
        assert low <= found[key] or key.startswith("ece")  # resamples of few tasks are seldom better calibrated
    assert calibration_summary(ROWS) == found


def test_decisions_are_the_first_looks_at_which_something_is_almost_certain() -> None:
    found = calibration_summary(ROWS)
    assert (found["decided"], found["decision_named"], found["decision_right"]) == (3, 2, 1)
    assert found["decision_probability_mean"] == pytest.approx((0.995 + 0.991) / 2)
    assert found["decision_looks_median"] == 2.5
    assert [row["verdict"] for row in ROWS] == ["right", "wrong", "right"]
    assert (found["unknown_named"], found["unknown_named_of"]) == (0, 1)
    assert (found["known_called_unknown"], found["known_called_unknown_of"]) == (0, 2)
    assert found["unknown_auc"] == 1.0
    late = [told(0, "c", [[0.99, 0.005, 0.005], [0.0, 0.0, 1.0]]), told(1, "a", [[0.004, 0.004, 0.992]])]
    wrong = calibration_summary(late)
    assert (wrong["unknown_named"], wrong["known_called_unknown"], wrong["decision_right"]) == (1, 1, 0)


def test_the_truth_is_never_infinitely_improbable() -> None:
    assert calibration_summary([told(0, "b", [[1.0, 0.0, 0.0]])])["log_loss"] == pytest.approx(-np.log(1e-12))


@given(st.integers(0, 10**6))
def test_bins_hold_every_prediction_and_as_many_looks_each(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = [told(i, "abc"[i % 3], rng.dirichlet([0.3] * 3, size=rng.integers(1, 9)).tolist()) for i in range(12)]
    looks = looks_of(rows)
    for predictions in (looks.leader, looks.every):
        for bins in (equal_width(predictions), equal_count(predictions)):
            assert sum(each["n"] for each in bins) == len(predictions.predicted)
            assert sum(each["n"] * each["observed"] for each in bins) == pytest.approx(predictions.observed.sum())
            assert all(each["lowest"] <= each["predicted"] + 1e-9 for each in bins)
        counts = [each["n"] for each in equal_count(predictions)]
        assert max(counts) - min(counts) <= 1


def test_honest_probabilities_have_little_error_and_bold_ones_much() -> None:
    rng = np.random.default_rng(5)
    honest, bold = [], []
    for i in range(400):
        p = rng.uniform(0.5, 1.0)
        truth = "a" if rng.random() < p else "b"
        honest.append(told(i, truth, [[p, 1.0 - p, 0.0]]))
        bold.append(told(i, truth, [[1.0 - (1.0 - p) ** 4, (1.0 - p) ** 4, 0.0]]))
    found, bolder = calibration_summary(honest), calibration_summary(bold)
    assert found["ece"] < 0.05 < 0.1 < bolder["ece_bootstrap95"][0] < bolder["ece"]
    assert found["ece_every"] < bolder["ece_every"]
    assert found["log_loss"] < bolder["log_loss"]


def test_any_calibration_can_be_drawn(tmp_path: Path) -> None:
    rows = ROWS + [row | {"method": "other"} for row in ROWS[:2]]
    assert [path.name for path in draw_calibration(Report("calibration", {}, rows), tmp_path)] == [
        "reliability.png",
        "unknown.png",
    ]
    failed = ROWS[0] | {"probabilities": [], "decision": None, "verdict": "failed", "object": "", "looks": 0}
    failed["unknown_probability"] = None
    report = Report("calibration", {}, [failed])
    assert report.summaries()["filter"]["ece"] is None
    assert draw_calibration(report, tmp_path / "none") == []
    json.dumps(report.as_dict(), allow_nan=False)


SHORT = ("--views", "30", "--jobs", "1", "--looks", "12")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("calibration")
    (made / "short.toml").write_text("[camera]\nsize_px = 48\n")
    return made


@pytest.mark.needs_pybullet
def test_every_look_of_every_task_is_measured(folder: Path, tmp_path: Path, shell: Shell) -> None:
    common = ("--config", folder / "short.toml", "--cache", folder / "renders", *SHORT)
    typed = ("bench", "calibration", *common, "--runs", "4", "--candidates", "3", "--unknown-fraction", "0.4")
    ended = shell(*typed, "--json", tmp_path / "one.json", "--plot", tmp_path / "pictures")
    assert ended.code in (0, None), ended.err
    assert "ECE of the leader" in ended.out
    assert {path.name for path in (tmp_path / "pictures").iterdir()} == {"reliability.png", "unknown.png"}
    report: dict[str, Any] = json.loads((tmp_path / "one.json").read_text())
    assert (report["kind"], report["about"]["looks"]) == ("calibration", 12)
    assert {row["known"] for row in report["tasks"]} == {True, False}
    for row in report["tasks"]:
        assert row["looks"] == len(row["probabilities"]) == 12
        np.testing.assert_allclose(np.sum(row["probabilities"], axis=1), 1.0)
        assert len(row["probabilities"][0]) == 4
        assert row["unknown_probability"] == row["probabilities"][-1][-1]
    assert max(max(look) for row in report["tasks"] for look in row["probabilities"]) > 0.99  # and yet it went on
    assert report["summary"]["looks"] == 48
    assert shell(*typed, "--json", tmp_path / "two.json").code in (0, None)
    assert (tmp_path / "two.json").read_text() == (tmp_path / "one.json").read_text()


@pytest.mark.needs_pybullet
def test_an_interpreter_without_probabilities_is_refused(folder: Path, shell: Shell) -> None:
    common = ("--config", folder / "short.toml", "--cache", folder / "renders", *SHORT)
    ended = shell("bench", "calibration", *common, "--interpreter", "filter,path")
    assert ended.code == 2
    assert "'path' has no probabilities" in ended.err
