"""Tasks are a function of the seed, and figures are what they claim to be."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import trapezoid
from scipy.stats import mannwhitneyu
from seed_method import seed_config

from viewsep.bench.journal import Row
from viewsep.bench.methods import MEASURES, methods_for, random_motion
from viewsep.bench.roc import auc, roc_curve
from viewsep.bench.summary import OUTCOMES, mcnemar, summarise, verdict, wilson95
from viewsep.bench.tasks import draw_tasks, generated_objects, generated_pairs, pairs_from, pool_of
from viewsep.config import Config
from viewsep.errors import BadInput
from viewsep.plugins import make_descriptor

PAIRS = generated_pairs("face", 0, 3)
POOL = pool_of(PAIRS)


def test_pairs_and_truths_take_turns() -> None:
    tasks = draw_tasks(PAIRS, POOL, 12, 40)
    assert [task.seed for task in tasks] == list(range(40, 52))
    assert [task.source for task in tasks[:6]] == [pair[0] for pair in PAIRS] + [pair[1] for pair in PAIRS]
    for task, pair in zip(tasks, PAIRS * 4, strict=True):
        assert set(task.candidates) == set(pair)
        assert task.known


@given(st.integers(0, 10**6), st.integers(2, 6), st.sampled_from([0.0, 0.5, 1.0]))
def test_a_task_has_as_many_candidates_as_asked_and_the_look_alike_among_them(
    seed: int, candidates: int, unknown_fraction: float
) -> None:
    for pairs in (PAIRS, []):
        pool = [*POOL, *generated_objects(50, 2)]
        for task in draw_tasks(pairs, pool, 8, seed, candidates, unknown_fraction):
            assert len(set(task.candidates)) == candidates
            assert list(task.candidates) == sorted(task.candidates, key=pool.index)
            assert task.known or unknown_fraction > 0
            assert not (task.known and unknown_fraction == 1.0)
            if pairs:
                rival = next(a if b == task.source else b for a, b in pairs if task.source in (a, b))
                assert rival in task.candidates


def test_the_same_seed_asks_the_same_and_another_start_goes_on_where_the_first_one_ends() -> None:
    whole = draw_tasks(PAIRS, POOL, 12, 0, 3, 0.4)
    assert draw_tasks(PAIRS, POOL, 12, 0, 3, 0.4) == whole
    assert 0 < sum(not task.known for task in whole) < 12


def test_too_few_objects_for_the_candidates_are_refused() -> None:
    with pytest.raises(BadInput, match="--candidates 7 needs 7 objects, but there are 6"):
        draw_tasks(PAIRS, POOL, 1, 0, 7)
    with pytest.raises(BadInput, match="--candidates 6 with --unknown-fraction needs 7 objects"):
        draw_tasks(PAIRS, POOL, 1, 0, 6, 0.1)


def test_an_object_is_not_its_own_look_alike(tmp_path: Path) -> None:
    path = tmp_path / "pairs.csv"
    path.write_text("a,b\ntea,tea\n")
    with pytest.raises(BadInput, match="line 2: 'tea' is paired with itself"):
        pairs_from(path)


@pytest.mark.parametrize(
    ("outcome", "named", "known", "expected"),
    [
        ("identified", "tea", True, "right"),
        ("identified", "decaf", True, "wrong"),
        ("identified", "decaf", False, "wrong"),
        ("unknown", "", False, "right"),
        ("unknown", "", True, "unknown"),
        ("undecided", "", True, "undecided"),
        ("undecided", "", False, "undecided"),
        ("failed", "", True, "failed"),
    ],
)
def test_the_verdict_compares_what_was_said_with_the_truth(
    outcome: str, named: str, known: bool, expected: str
) -> None:
    assert verdict(outcome, named, "tea", known) == expected
    assert expected in OUTCOMES


@pytest.mark.parametrize(
    ("outcome", "named", "expected"),
    [
        ("indistinguishable", "", "right"),
        ("identified", "tea", "wrong"),  # by luck
        ("identified", "tea_copy", "wrong"),
        ("unknown", "", "unknown"),
        ("undecided", "", "undecided"),
    ],
)
def test_of_identical_twins_it_is_right_to_name_neither(outcome: str, named: str, expected: str) -> None:
    assert verdict(outcome, named, "tea", known=True, identical=True) == expected
    assert verdict("indistinguishable", "", "tea", known=True) == "indistinguishable"


def test_a_task_knows_whether_a_candidate_is_a_copy_of_the_truth() -> None:
    copies = generated_pairs("none", 0, 3)
    assert all(task.identical for task in draw_tasks(copies, pool_of(copies), 6, 0))
    assert not any(task.identical for task in draw_tasks(PAIRS, POOL, 6, 0, 3))
    with pytest.raises(BadInput, match="--twins none with --unknown-fraction"):
        draw_tasks(copies, pool_of(copies), 6, 0, 2, 1.0)


def told_unknown(known: Sequence[float | None], unknown: Sequence[float | None]) -> list[Row]:
    return [
        {"index": i, "verdict": "undecided", "known": kind, "unknown_probability": probability}
        for i, (kind, probability) in enumerate([(True, p) for p in known] + [(False, p) for p in unknown])
    ]


def test_the_auc_is_the_share_of_pairs_in_the_right_order_with_ties_by_half() -> None:
    found = summarise(told_unknown([0.1, 0.2, 0.5, None], [0.5, 0.9]))
    assert found["unknown_auc"] == pytest.approx((3 * 2 - 0.5) / 6)
    low, high = found["unknown_auc_bootstrap95"]
    assert 0.5 < low < found["unknown_auc"] < high <= 1.0
    for rows in (told_unknown([0.1], []), told_unknown([], [0.9]), told_unknown([0.1], [None])):
        assert summarise(rows)["unknown_auc"] is None


@given(st.lists(st.floats(0, 1), min_size=1, max_size=30), st.lists(st.floats(0, 1), min_size=1, max_size=30))
def test_the_auc_is_the_area_under_the_curve_and_the_rank_statistic(without: list[float], having: list[float]) -> None:
    area = auc(without, having)
    assert area == pytest.approx(mannwhitneyu(having, without).statistic / len(without) / len(having))
    false, true = roc_curve(without, having).T
    assert area == pytest.approx(trapezoid(true, false))
    assert (np.diff(false) >= 0).all()
    assert (true[-1], false[-1]) == (1.0, 1.0)


def rows(verdicts: str, **values: float) -> list[Row]:
    letters = {"r": "right", "w": "wrong", "u": "undecided", "f": "failed"}
    return [{"index": i, "verdict": letters[letter]} | values for i, letter in enumerate(verdicts)]


def test_a_summary_counts_every_row() -> None:
    told = rows("rrrwuf", travel_deg=10.0)
    told[0] |= {"travel_deg": 100.0, "pose_error_deg": 5.0, "travel_over_optimum": 3.0, "step_ms": 2.0}
    told[3] |= {"pose_error_deg": 45.0}
    summary = summarise(told)
    assert summary["n"] == 6
    assert [summary[outcome] for outcome in OUTCOMES] == [3, 1, 1, 0, 0, 1]
    assert summary["travel_deg_median"] == 10.0
    assert summary["travel_deg_p95"] == pytest.approx(77.5)
    assert summary["pose_error_deg_mean"] == 25.0
    assert summary["pose_error_under_22.6_share"] == 0.5
    assert summary["looks_median"] is None
    low, high = summary["right_wilson95"]
    assert low < 0.5 < high


def test_wilsons_interval_is_the_published_one() -> None:
    assert wilson95(8, 10) == pytest.approx([0.4901, 0.9433], abs=1e-4)
    assert wilson95(0, 20)[0] == 0.0


def test_mcnemar_looks_at_the_tasks_that_only_one_method_gets_right() -> None:
    found = mcnemar(rows("rrrrrrww"), rows("wwwwwrrw"))
    assert (found["only_first_right"], found["only_second_right"], found["n"]) == (5, 1, 8)
    assert found["p_value"] == pytest.approx(2 * 7 / 2**6)
    assert mcnemar(rows("rw"), rows("rw"))["p_value"] == 1.0


def test_methods_are_compared_with_the_options_they_were_given() -> None:
    config = seed_config(interpreter={"options": {"hypotheses": 20}})
    methods = methods_for(config, [], [], MEASURES)
    assert [method.name for method in methods] == ["path w0+w1+w2", "path w1", "path w0+w1"]
    assert methods[1].config.interpreter.options == {"hypotheses": 20, "rated_by": ["w1"]}
    for method in methods:
        make_descriptor(method.config.descriptor)
    both = methods_for(config, ["path"], ["separating", "random"], ["w1"])
    assert [method.name for method in both] == ["path w1, separating", "path w1, random"]
    assert [method.config.planner.name for method in both] == ["separating", "random"]
    beside = methods_for(Config(), ["filter", "path"], [], ["w1"])
    assert [(method.name, method.config.planner.name) for method in beside] == [
        ("filter", "information"),
        ("path w1", "separating"),
    ]
    asked = methods_for(Config(), ["path"], ["information"], ["w1"])
    assert [method.config.planner.name for method in asked] == ["information"]
    assert random_motion(methods[0]).config.planner.name == "random"
    with pytest.raises(BadInput, match="'w7' is none of"):
        methods_for(config, [], [], ["w7"])
