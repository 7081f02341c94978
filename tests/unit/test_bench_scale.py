"""The bench of many candidates; its times are looked at, not judged."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shell import Shell

from viewsep.bench.memory import resident_mb
from viewsep.plots.scale import scale


def row(method: str, candidates: int) -> dict[str, Any]:
    times = {f"{what}_ms_{which}": float(candidates) for what in ("interpret", "plan") for which in ("median", "p95")}
    return {"method": method, "candidates": candidates, "models_mb": 0.0, "engine_mb": 3.0 * candidates, **times}


def test_times_and_memory_are_drawn_over_the_number_of_candidates() -> None:
    rows = [row(method, count) for method in ("filter", "path") for count in (2, 10, 100)]
    about = {"config": {"task": {"looks_per_s": 4.0}}}
    figure = scale({"about": about, "rows": rows, "learning": {"wall_s_median": 1.0}})
    for axes in figure.axes:
        assert (axes.get_xscale(), axes.get_yscale()) == ("log", "log")
    lines = {str(line.get_label()): np.asarray(line.get_data(), np.float64) for line in figure.axes[1].get_lines()}
    np.testing.assert_array_equal(lines["path: the engine, beside them"], [[2, 10, 100], [6, 30, 300]])
    assert len([line for line in figure.axes[0].get_lines() if str(line.get_label()).startswith("filter")]) == 2


def test_memory_that_is_used_is_resident() -> None:
    before = resident_mb()
    used = np.ones(8_000_000)
    assert 50.0 < resident_mb() - before < 80.0
    assert used[0] == 1.0


@pytest.mark.needs_pybullet
def test_every_number_of_candidates_is_measured(tmp_path: Path, shell: Shell) -> None:
    (tmp_path / "small.toml").write_text("[camera]\nsize_px = 48\n")
    typed = ("bench", "scale", "--counts", "4,2", "--looks", "25", "--views", "30", "--config", tmp_path / "small.toml")
    more = ("--jobs", "1", "--cache", tmp_path / "renders", "--json", tmp_path / "scale.json")
    ended = shell(*typed, *more, "--plot", tmp_path / "pictures")
    assert ended.code in (0, None), ended.err
    assert (tmp_path / "pictures" / "scale.png").is_file()
    found = json.loads((tmp_path / "scale.json").read_text())
    assert found["learning"]["objects"] == 4
    assert found["learning"]["wall_s_median"] > 0.0
    assert [row["candidates"] for row in found["rows"]] == [2, 4]
    for row in found["rows"]:
        assert (row["method"], row["looks"], row["runs"]) == ("filter", 50, 2)
        assert 0.0 < row["interpret_ms_median"] <= row["interpret_ms_p95"]
        assert 0.0 < row["plan_ms_median"] <= row["plan_ms_p95"]
        assert row["engine_mb"] > 0.0
    assert found["rows"][0]["first"] > 0  # two boxes of different print


@pytest.mark.parametrize("counts", ["1,2", "many", "2,,3", ""])
def test_numbers_of_candidates_must_make_sense(counts: str, shell: Shell) -> None:
    ended = shell("bench", "scale", "--counts", counts)
    assert ended.code == 2
    assert "--counts" in ended.err
