"""`viewsep bench` end to end on generated boxes: tasks, figures, pictures, and what does not change them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pytest
from dask_cluster import dask_cluster
from seed_method import SEED_TOML
from shell import Shell
from view_sets import ring, write_view_set

from viewsep.bench.summary import OUTCOMES, TIMES

pytestmark = pytest.mark.needs_pybullet

SHORT = "[camera]\nsize_px = 48\n[task]\nmax_looks = 40\n"
SEED_SHORT = SHORT + SEED_TOML
SUMMARY_KEYS = {
    *("n", "right", "wrong", "undecided", "unknown", "indistinguishable", "failed", "right_wilson95", "wrong_wilson95"),
    *("travel_deg_median", "travel_over_optimum_median", "looks_median", "pose_error_deg_mean", "pose_error_deg_p95"),
    "step_ms_median",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """With a configuration, and pictures that the tests share."""
    made = tmp_path_factory.mktemp("bench")
    (made / "short.toml").write_text(SHORT)
    (made / "seed.toml").write_text(SEED_SHORT)
    return made


def common(folder: Path, name: str = "short") -> tuple[str | Path, ...]:
    return ("--config", folder / f"{name}.toml", "--views", "30", "--cache", folder / "renders")


def timeless(report: dict[str, Any]) -> dict[str, Any]:
    """A report without what the clock says."""
    for summary in report["summaries"].values():
        for key in TIMES:
            assert summary.pop(key) > 0.0
    for row in report["tasks"]:
        del row["step_ms"], row["step_cpu_ms"]
    if report["kind"] == "separation":
        for key in TIMES:
            del report["summary"][key]
    return report


@pytest.fixture
def separated(folder: Path, tmp_path: Path, shell: Shell) -> dict[str, Any]:
    result = tmp_path / "one.json"
    typed = ("bench", "separation", *common(folder, "seed"), "--runs", "4", "--jobs", "1", "--json", result)
    ended = shell(*typed, "--plot", tmp_path / "pictures", "--disturb", "light=0.1,noise=0.02")
    assert ended.code in (0, None), ended.err
    assert "path w0+w1+w2" in ended.out
    assert not list(tmp_path.glob("*.partial"))
    assert {path.name for path in (tmp_path / "pictures").iterdir()} >= {"outcomes.png", "failures.png"}
    found: dict[str, Any] = json.loads(result.read_text())
    return found


def test_a_separation_reports_tasks_and_figures(separated: dict[str, Any]) -> None:
    summary = separated["summary"]
    assert summary.keys() >= SUMMARY_KEYS
    assert list(separated["summaries"]) == ["path w0+w1+w2", "path w1", "path w0+w1"]
    assert separated["summaries"]["path w0+w1+w2"] == summary
    main = [row for row in separated["tasks"] if row["method"] == "path w0+w1+w2"]
    assert len(separated["tasks"]) == 12
    assert [row["seed"] for row in main] == [0, 1, 2, 3]
    assert [row["truth"] for row in main] == [f"product_{i}" for i in range(4)]
    assert sum(summary[outcome] for outcome in OUTCOMES) == summary["n"] == 4
    for row in main:
        assert row["known"]
        assert len(row["candidates"]) == 2
        assert row["travel_over_optimum"] == max(row["travel_deg"], 4.0) / max(row["optimum_deg"], 4.0)
        assert (row["verdict"] == "right") == (row["object"] == row["truth"])
        assert row["pose_error_symmetric_deg"] == pytest.approx(row["pose_error_deg"])  # printed boxes have no symmetry
    assert [test["second"] for test in separated["comparisons"]] == ["path w1", "path w0+w1"]
    assert separated["about"]["config"]["sim"]["light"] == 0.1


@pytest.mark.long
def test_figures_do_not_depend_on_processes(
    separated: dict[str, Any], folder: Path, tmp_path: Path, shell: Shell
) -> None:
    result = tmp_path / "two.json"
    typed = ("bench", "separation", *common(folder, "seed"), "--runs", "4", "--jobs", "2", "--json", result)
    shell(*typed, "--disturb", "light=0.1,noise=0.02")
    assert timeless(json.loads(result.read_text())) == timeless(separated)


@pytest.mark.long
def test_figures_do_not_depend_on_the_machines(
    separated: dict[str, Any], folder: Path, tmp_path: Path, shell: Shell
) -> None:
    pytest.importorskip("distributed")
    result = tmp_path / "cluster.json"
    with dask_cluster(tmp_path, folder) as address:
        typed = (
            "bench",
            "separation",
            *common(folder, "seed"),
            "--runs",
            "4",
            "--scheduler",
            address,
            "--json",
            result,
        )
        ended = shell(*typed, "--disturb", "light=0.1,noise=0.02")
    assert ended.code in (0, None), ended.err
    assert timeless(json.loads(result.read_text())) == timeless(separated)


def test_poses_are_measured_for_every_variant_and_alignment(folder: Path, tmp_path: Path, shell: Shell) -> None:
    result = tmp_path / "pose.json"
    typed = ("bench", "pose", *common(folder), "--runs", "2", "--jobs", "1", "--json", result)
    ended = shell(*typed, "--plot", tmp_path / "pictures")
    assert ended.code in (0, None), ended.err
    report = json.loads(result.read_text())
    assert len(report["summary"]) == 8
    chosen = report["about"]["config"]  # the seed's experiment, though the file does not say so
    assert (chosen["descriptor"]["name"], chosen["interpreter"]["name"]) == ("cch", "path")
    for method, summary in report["summary"].items():
        assert summary.keys() >= SUMMARY_KEYS
        rows = [row for row in report["tasks"] if row["method"] == method]
        assert len(rows) == summary["n"] == 2
        assert summary["pose_error_deg_mean"] == pytest.approx(sum(row["pose_error_deg"] for row in rows) / 2)
        for row in rows:
            failed = row["outcome"] == "failed"
            assert failed == (row["verdict"] == "failed") == (row["looks"] == 40 and row["travel_deg"] == 195.0)
            assert math.isfinite(row["pose_error_deg"])
            assert row["pose_error_symmetric_deg"] == pytest.approx(row["pose_error_deg"])
    assert {path.name for path in (tmp_path / "pictures").iterdir()} == {
        *("convergence.png", "pose_error.png", "comparisons.png")
    }


def test_photos_are_an_experiment_too(folder: Path, tmp_path: Path, shell: Shell) -> None:
    for seed, name in enumerate(("tea", "decaf", "herbal")):
        write_view_set(tmp_path / "photos" / name, seed, ring(*range(0, 360, 10)))
    result = tmp_path / "photos.json"
    typed = ("bench", "separation", "--objects", tmp_path / "photos", "--every", "2", "--candidates", "3")
    more = ("--runs", "3", "--measures", "w0+w1+w2", "--baselines", "nearest,vote,sift", "--jobs", "1")
    ended = shell(*typed, *more, "--config", folder / "seed.toml", "--json", result)
    assert ended.code in (0, None), ended.err
    report = json.loads(result.read_text())
    assert list(report["summaries"]) == ["path w0+w1+w2", "nearest", "vote", "sift"]
    path, vote = ([row for row in report["tasks"] if row["method"] == m] for m in ("path w0+w1+w2", "vote"))
    for ours, theirs in zip(path, vote, strict=True):
        assert theirs["looks"] == min(ours["looks"], 18)  # there are no more photos to look at
        assert theirs["candidates"] == ours["candidates"] == ["decaf", "herbal", "tea"]
    assert report["summaries"]["vote"]["right"] == 3


def test_an_object_that_is_no_candidate_cannot_be_right(folder: Path, tmp_path: Path, shell: Shell) -> None:
    result = tmp_path / "unknown.json"
    typed = ("bench", "separation", *common(folder, "seed"), "--runs", "2", "--unknown-fraction", "1", "--jobs", "1")
    assert shell(*typed, "--measures", "w1", "--json", result).code in (0, None)
    report = json.loads(result.read_text())
    for row in report["tasks"]:
        assert not row["known"]
        assert row["truth"] not in row["candidates"]
        assert row["pose_error_deg"] is None
    assert report["summary"]["right"] == 0


def test_posteriors_say_how_likely_none_of_the_candidates_is(folder: Path, tmp_path: Path, shell: Shell) -> None:
    result = tmp_path / "posterior.json"
    typed = ("bench", "separation", *common(folder), "--runs", "3", "--unknown-fraction", "0.4", "--jobs", "1")
    more = ("--pose-tolerance", "20", "--descriptor", "opponent", "--json", result)
    ended = shell(*typed, *more)
    assert ended.code in (0, None), ended.err
    assert "AUC of unknown" in ended.out
    report = json.loads(result.read_text())
    assert {row["known"] for row in report["tasks"]} == {True, False}
    assert all(0.0 <= row["unknown_probability"] <= 1.0 for row in report["tasks"])
    low, high = report["summary"]["unknown_auc_bootstrap95"]
    assert low <= report["summary"]["unknown_auc"] <= high
    assert report["about"]["config"]["task"]["pose_tolerance_deg"] == 20.0
    assert report["about"]["config"]["descriptor"]["name"] == "opponent"


def test_identical_twins_are_scored_by_themselves(folder: Path, tmp_path: Path, shell: Shell) -> None:
    result = tmp_path / "copies.json"
    typed = ("bench", "separation", *common(folder), "--runs", "2", "--twins", "none", "--jobs", "1")
    assert shell(*typed, "--json", result).code in (0, None)
    for row in json.loads(result.read_text())["tasks"]:
        assert row["identical"]
        assert (row["verdict"] == "right") == (row["outcome"] == "indistinguishable")
        assert row["unknown_probability"] is not None
    refused = shell("bench", "separation", *common(folder), "--twins", "none", "--unknown-fraction", "1")
    assert refused.code == 2
    assert "leave one of the two out" in refused.err


def test_measures_without_paths_and_the_default_methods(folder: Path, tmp_path: Path, shell: Shell) -> None:
    refused = shell("bench", "separation", *common(folder), "--measures", "w1")
    assert refused.code == 2
    assert "is about path hypotheses: add --interpreter path" in " ".join(refused.err.split())
    result = tmp_path / "default.json"
    typed = ("bench", "separation", *common(folder), "--runs", "1", "--jobs", "1", "--rig", "pan_tilt")
    assert shell(*typed, "--descriptor", "opponent+rings:rings.frequencies=5", "--json", result).code in (0, None)
    report = json.loads(result.read_text())
    assert list(report["summaries"]) == ["filter"]
    assert report["about"]["config"]["planner"]["name"] == "information"
    assert report["about"]["config"]["descriptor"]["options"] == {"rings.frequencies": 5}


def test_descriptor_and_tolerance_must_make_sense(folder: Path, shell: Shell) -> None:
    for option, value, says in (("--descriptor", "nope", "cch, opponent"), ("--pose-tolerance", "200", "180")):
        ended = shell("bench", "separation", *common(folder), option, value)
        assert ended.code == 2
        assert says in ended.err
