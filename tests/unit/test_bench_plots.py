"""Pictures of experiments: what is drawn is what the rows say, and any report can be drawn."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.container import BarContainer
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from viewsep.bench.journal import Row
from viewsep.bench.report import Report
from viewsep.bench.summary import wilson95
from viewsep.errors import BadInput
from viewsep.plots.answers import MOST, OTHER, are_pairs, confusions, failures, outcomes, pair_answers
from viewsep.plots.bench import (
    convergence,
    draw_pose,
    draw_separation,
    over_iterations,
    path_rating,
    pose_comparisons,
    pose_errors,
    separation_comparisons,
)

MAIN = "path w0+w1+w2"


def pose_row(index: int, method: str, error: float | None, variance: list[float | None], **other: Any) -> Row:
    row = {
        "index": index,
        "seed": index,
        "method": method,
        "truth": "box",
        "object": "box",
        "outcome": "converged",
        "verdict": "right",
        "pose_error_deg": error,
        "course": {"variance_deg2": variance, "comparisons": [100, 40, 20 + index][: len(variance)]},
    }
    return row | other


def pose_report(rows: list[Row], **options: Any) -> Report:
    return Report("pose", {"views": 100, "config": {"interpreter": {"name": "path", "options": options}}}, rows)


def task_row(index: int, truth: str, said: str, method: str = MAIN, **other: Any) -> Row:
    """A task in which `said` is an object's name or an outcome."""
    ended = said in ("undecided", "unknown", "indistinguishable", "failed")
    row = {
        "index": index,
        "seed": 40 + index,
        "method": method,
        "truth": truth,
        "known": True,
        "candidates": ["a", "b"],
        "outcome": said if ended else "identified",
        "object": "" if ended else said,
        "verdict": said if ended else "right" if said == truth else "wrong",
    }
    return row | other


def course(truth: list[float | None], rival: list[float | None], comparisons: list[float]) -> dict[str, Any]:
    phases = ["exploring", "approaching", "judging"]
    return {"phase": phases[: len(truth)], "comparisons": comparisons, "w1_deg": {"a": truth, "b": rival}}


def separation_report(rows: list[Row]) -> Report:
    return Report("separation", {"views": 100, "config": {"interpreter": {"name": "path", "options": {}}}}, rows)


def line(axes: Axes, label: str) -> tuple[list[float], list[float]]:
    """The points of the line whose label begins like that."""
    (found,) = (found for found in axes.get_lines() if str(found.get_label()).startswith(label))
    x, y = (np.asarray(data, np.float64) for data in found.get_data())
    return x.tolist(), y.tolist()


def bars(figure: Figure, kind: str) -> list[tuple[float, float]]:
    """Begin and width of the bars of one kind, from the top."""
    found = [each for each in figure.axes[0].containers if isinstance(each, BarContainer) and each.get_label() == kind]
    return [(bar.get_x(), bar.get_width()) for container in found for bar in container.patches]


# Poses


def test_variances_are_drawn_as_medians_with_infinite_ones_above_all() -> None:
    variances: list[list[float | None]] = [[None, 8.0, 4.0], [None, 2.0, None], [None, None, None]]
    rows = [pose_row(i, f"initial, {a}", 1.0, v) for a in ("fig4", "wahba") for i, v in enumerate(variances)]
    rows[2]["verdict"] = "failed"
    figure = convergence(pose_report(rows, converged_below_deg2=7.5))
    assert len(figure.axes) == 2
    x, y = line(figure.axes[0], "initial: 2 of 3 converged")
    assert x == [1, 2, 3]
    np.testing.assert_equal(y, [np.nan, 8.0, np.nan])  # of 4 and two infinite ones the median is infinite
    assert line(figure.axes[0], "converged below 7.5 deg²")[1] == [7.5, 7.5]
    assert figure.axes[0].get_yscale() == "log"
    assert line(convergence(pose_report(rows)).axes[1], "converged below")[1][0] > 0.0


def test_runs_count_as_long_as_they_last() -> None:
    rows = [pose_row(0, "m", 1.0, [3.0, 5.0, 7.0]), pose_row(1, "m", 1.0, [None]), {"method": "m"}]
    variances = over_iterations(rows, "variance_deg2", np.inf)
    assert [values.tolist() for values in variances] == [[3.0, np.inf], [5.0], [7.0]]
    assert [values.tolist() for values in over_iterations(rows, "comparisons")] == [[100, 100], [40], [20]]


def test_pose_errors_are_drawn_as_shares_of_all_runs() -> None:
    rows = [pose_row(i, "initial, fig4", error, [None]) for i, error in enumerate((30.0, 10.0, None, 20.0))]
    rows[0]["verdict"] = "failed"
    x, y = line(pose_errors(pose_report(rows)).axes[0], "initial, fig4: mean 20.0°, 1 failed")
    assert x[1:4] == [10.0, 20.0, 30.0]
    assert y == [0.0, 0.25, 0.5, 0.75, 0.75]
    assert line(pose_errors(pose_report(rows)).axes[0], "node spacing")[0] == [22.6, 22.6]


def test_pose_comparisons_are_means_beside_brute_force() -> None:
    rows = [pose_row(i, "loop_free, fig4", 1.0, [None] * 3) for i in range(3)]
    axes = pose_comparisons(pose_report(rows)).axes[0]
    assert line(axes, "loop free") == ([1, 2, 3], [100, 40, 21])
    assert line(axes, "brute force: all 100")[1] == [100, 100]
    assert line(axes, "the paper's 14")[1] == [14, 14]


# Separations


def test_bars_are_the_shares_and_intervals_those_of_wilson() -> None:
    said = ["a"] * 5 + ["b", "undecided", "unknown", "indistinguishable", "failed"]
    rows = [task_row(i, "a", word) for i, word in enumerate(said)]
    rows += [task_row(i, "a", "a", "sift") for i in range(4)]
    figure = outcomes(separation_report(rows))
    assert bars(figure, "right") == [(0.0, 0.5), (0.0, 1.0)]
    assert bars(figure, "indistinguishable")[0] == pytest.approx((0.5, 0.1))
    assert bars(figure, "unknown")[0] == pytest.approx((0.6, 0.1))
    assert bars(figure, "undecided")[0] == pytest.approx((0.7, 0.1))
    assert bars(figure, "failed")[0] == pytest.approx((0.8, 0.1))
    assert bars(figure, "wrong")[0] == pytest.approx((0.9, 0.1))
    drawn = [found for found in figure.axes[0].collections if isinstance(found, LineCollection)]
    spans = [segment[:, 0] for found in drawn for segment in found.get_segments()]
    low, high = wilson95(1, 10)
    for span, expected in zip(spans, (wilson95(5, 10), (1 - high, 1 - low), wilson95(4, 4)), strict=False):
        np.testing.assert_allclose(span, expected, atol=1e-12)
    written = [text.get_text() for text in figure.axes[0].texts]
    assert {"5", "24 - 76 %", "10", "51 - 100 %", "unknown", "indistinguishable"} <= set(written)
    assert "unknown" not in {text.get_text() for text in outcomes(separation_report(rows[:7])).axes[0].texts}


def test_the_path_course_is_that_of_the_first_right_task_with_both_courses() -> None:
    alone = {"phase": ["exploring"], "comparisons": [9.0], "w1_deg": {"a": [1.0]}}
    rows = [
        task_row(0, "a", "b", course=course([9.0], [9.0], [1.0])),
        task_row(1, "a", "a", course=alone),
        task_row(2, "a", "a", course=course([None, None], [1.0, 2.0], [1.0, 1.0])),
        task_row(3, "b", "b", course=course([5.0, None, 9.0], [5.0, 4.0, 3.0], [1.0] * 3)),
        task_row(4, "a", "a", course=course([2.0], [3.0], [1.0])),
    ]
    figure = path_rating(separation_report(rows))
    assert figure is not None
    axes = figure.axes[0]
    assert line(axes, "truth: b") == ([1, 2, 3], [5, 4, 3])
    np.testing.assert_equal(line(axes, "rival: a")[1], [5, np.nan, 9])
    shades = [(patch.get_x(), patch.get_width()) for patch in axes.patches if isinstance(patch, Rectangle)]
    assert shades == [(0.5, 1.0), (1.5, 1.0), (2.5, 1.0)]
    assert "task 4 of 5 (seed 43)" in axes.get_title(loc="left")
    assert path_rating(separation_report(rows[:3])) is None


def test_comparisons_are_means_of_the_tasks_still_running() -> None:
    rows = [
        task_row(0, "a", "a", course=course([1.0], [1.0], [100.0])),
        task_row(1, "a", "a", course=course([1.0] * 3, [1.0] * 3, [50.0, 20.0, 14.0])),
        task_row(2, "a", "failed"),
        task_row(0, "a", "a", "sift"),
    ]
    figure = separation_comparisons(separation_report(rows))
    assert figure is not None
    above, below = figure.axes
    assert line(above, f"{MAIN} (n = 2)") == ([1, 2, 3], [75, 20, 14])
    assert np.asarray(below.get_lines()[0].get_ydata()).tolist() == [2, 1, 1]
    assert len(below.get_lines()) == 1
    assert separation_comparisons(separation_report(rows[2:])) is None


def test_brute_force_is_drawn_only_where_its_cost_is_known() -> None:
    rows = [task_row(0, "a", "a", course=course([1.0], [1.0], [30.0]))]
    figure = separation_comparisons(Report("separation", {}, rows))
    assert figure is not None
    assert not [each for each in figure.axes[0].get_lines() if "brute force" in str(each.get_label())]


def test_confusions_are_counted_by_what_was_held_and_said() -> None:
    said = [("a", "a"), ("a", "a"), ("a", "b"), ("b", "undecided"), ("b", "b"), ("c", "failed"), ("c", "a")]
    rows = [task_row(i, truth, word, candidates=["a", "b", "c"]) for i, (truth, word) in enumerate(said)]
    rows.append(task_row(7, "a", "unknown", known=False) | {"verdict": "right"})
    answers = confusions(rows)
    assert answers.rows == ["a", "a (no candidate)", "b", "c"]
    assert answers.columns == ["a", "b", "failed", "undecided", "unknown"]
    assert answers.groups == [("object that was named", 2), ("none named", 3)]
    assert answers.counts.tolist() == [[2, 1, 0, 0, 0], [0, 0, 0, 0, 1], [0, 1, 0, 1, 0], [1, 0, 1, 0, 0]]
    assert answers.tasks[:, 0].tolist() == [3, 1, 2, 2]
    kinds = answers.kinds[answers.counts > 0].tolist()
    assert kinds == ["right", "wrong", "right", "right", "undecided", "wrong", "failed"]


def test_an_object_called_like_an_outcome_is_no_outcome() -> None:
    row = task_row(0, "a", "b", candidates=["a", "undecided", "b"]) | {"object": "undecided"}
    answers = confusions([row, task_row(1, "a", "undecided")])
    assert answers.columns == ["undecided", "undecided"]
    assert answers.counts.tolist() == [[1, 1]]
    assert answers.kinds.tolist() == [["wrong", "undecided"]]


def test_of_many_objects_those_with_the_most_failures_are_shown() -> None:
    names = [f"object {i:03d}" for i in range(3 * MOST)]
    rows = [task_row(i, name, name if i < MOST else names[0]) for i, name in enumerate(names)]
    rows += [task_row(len(rows) + i, name, name) for i, name in enumerate(names[-MOST - 5 :])]
    rows += [task_row(len(rows) + i, name, f"once {i}") for i, name in enumerate(names[-3:])]
    answers = confusions(rows)
    assert len(answers.rows) == MOST
    assert answers.hidden == 2 * MOST
    assert set(names[-3:]) <= set(answers.rows)
    assert not set(names[:MOST]) & set(answers.rows)
    assert answers.counts.sum() == sum(row["truth"] in answers.rows for row in rows)
    several = separation_report([row | {"candidates": ["a", "b", "c"]} for row in rows])
    assert f"the {MOST} of {3 * MOST} rows" in failures(several).texts[1].get_text()


def test_names_that_belong_to_no_shown_object_are_counted_together() -> None:
    rows = [task_row(i, "a", f"other {i}") for i in range(MOST)] + [task_row(MOST, "a", "a")]
    answers = confusions(rows)
    assert answers.columns == ["a", OTHER]
    assert answers.counts.tolist() == [[1, MOST]]
    assert answers.kinds.tolist() == [["right", "wrong"]]


def test_pairs_are_counted_per_method() -> None:
    pairs = [("a", "b"), ("c", "d")]
    rows = [
        task_row(i, pairs[i % 2][0], said, method, candidates=list(pairs[i % 2]))
        for method, words in ((MAIN, ("a", "d", "a", "undecided")), ("sift", ("b", "d", "a", "c")))
        for i, said in enumerate(words)
    ]
    answers = pair_answers(separation_report(rows))
    assert answers.rows == ["a / b", "c / d"]
    assert answers.columns == ["right", "undecided", "wrong"] * 2
    assert answers.groups == [(MAIN, 3), ("sift", 3)]
    assert answers.counts.tolist() == [[2, 0, 0, 1, 0, 1], [0, 1, 1, 1, 0, 1]]
    assert (answers.tasks == 2).all()
    figure = failures(separation_report(rows))
    numbers = [text.get_text() for text in figure.axes[0].texts if text.get_text().isdigit()]
    assert numbers == ["2", "1", "1", "1", "1", "1", "1"]


@pytest.mark.parametrize(
    ("candidates", "known", "expected"),
    [
        ([["a", "b"], ["c", "d"]], True, True),
        ([["a", "b"], ["a", "c"], ["b", "c"]], True, True),  # three look-alikes
        ([["a", "b"], ["a", "c"], ["a", "d"], ["b", "c"], ["b", "d"]], True, False),  # drawn at random
        ([["a", "b", "c"]], True, False),
        ([["a", "b"]], False, False),
    ],
)
def test_pairs_are_what_comes_in_pairs(candidates: list[list[str]], known: bool, expected: bool) -> None:
    assert are_pairs([task_row(i, "a", "a", candidates=c, known=known) for i, c in enumerate(candidates)]) is expected


def test_right_answers_are_paler_than_all_others() -> None:
    said = ["a", "b", "undecided", "failed"]
    rows = [task_row(i, truth, word) for truth in "ab" for i, word in enumerate(said)]
    colours = np.asarray(failures(separation_report(rows)).axes[0].images[0].get_array())
    assert colours.min(axis=2).argmax() == 0
    assert colours.shape == (1, 4, 3)


# Files


def extremes() -> dict[str, Report]:
    long = [f"${'x' * i}_a very long name of an object ^{{ {i}" for i in range(45)]
    rng = np.random.default_rng(3)
    wild = [
        task_row(i, long[i % 45], str(rng.choice([*long, "undecided", "failed", "unknown"])), candidates=long)
        for i in range(150)
    ]
    seen = course([1.0], [2.0], [5.0])
    unseen = course([None], [None], [0.0])
    name = "method with a long name " * 3
    rows = {
        "one method, two tasks": [task_row(i, "a", "a", course=seen) for i in (0, 1)],
        "all failed": [task_row(i, "a", "failed", method) for method in (MAIN, "filter") for i in range(3)],
        "many long names": wild,
        "many methods": [task_row(0, "a", "b", f"{name}{i}") for i in range(9)],
        "no values": [task_row(0, "a", "a", course=unseen, pose_error_deg=None)],
    }
    return {case: separation_report(each) for case, each in rows.items()}


def read_png(path: Path) -> tuple[int, int]:
    """Width and height of a picture that is small enough and not empty."""
    data = path.read_bytes()
    assert data.startswith(b"\x89PNG\r\n")
    assert len(data) < 300_000
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.std() > 5
    return image.shape[1], image.shape[0]


@pytest.mark.parametrize("name", extremes())
def test_any_separation_report_can_be_drawn(tmp_path: Path, name: str) -> None:
    written = draw_separation(extremes()[name], tmp_path / "new" / "pictures")
    assert sorted(written) == sorted((tmp_path / "new" / "pictures").iterdir())
    assert {"outcomes.png", "failures.png"} <= {path.name for path in written}
    assert ("path_rating.png" in {path.name for path in written}) == (name == "one method, two tasks")
    for path in written:
        width, height = read_png(path)
        assert width <= 1600
        assert height <= 1600


@pytest.mark.parametrize(
    ("methods", "variances"),
    [
        (["initial, fig4", "particles, wahba"], [None, 3.0, 0.0]),
        (["accumulated, fig4"], [None, None, None]),
        (["accumulated, fig4"], [1.0]),
        (["filter"], []),
    ],
)
def test_any_pose_report_can_be_drawn(tmp_path: Path, methods: list[str], variances: list[float | None]) -> None:
    rows = [pose_row(i, method, None if i else 5.0, variances) for method in methods for i in range(2)]
    written = draw_pose(pose_report(rows), tmp_path)
    assert [path.name for path in written] == ["convergence.png", "pose_error.png", "comparisons.png"]
    assert sorted(written) == sorted(tmp_path.iterdir())
    for path in written:
        width, height = read_png(path)
        assert width <= 1600
        assert height <= 1600


def test_a_folder_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    report = extremes()["one method, two tasks"]
    (tmp_path / "file").write_text("")
    (tmp_path / "taken" / "outcomes.png").mkdir(parents=True)
    for folder, says in (("file", "file: it is a file"), ("file/below", "below"), ("taken", r"outcomes\.png")):
        with pytest.raises(BadInput, match=says):
            draw_separation(report, tmp_path / folder)
        with pytest.raises(BadInput, match="file"):
            draw_pose(report, tmp_path / "file")
    assert not list(tmp_path.rglob("*.part"))
