"""Who is right after how many looks, counted."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest
from shell import Shell

from viewsep.bench.looks import looks_summary


def test_right_ones_are_counted_for_each_number_of_looks() -> None:
    ours, theirs = np.zeros((10, 2), bool), np.zeros((10, 2), bool)
    ours[:8, 0], theirs[2:4, 0] = True, True
    ours[:, 1] = theirs[:, 1] = True
    rows = [{"right": {"a": a.tolist(), "b": b.tolist()}} for a, b in zip(ours, theirs, strict=True)]
    after = looks_summary(rows)
    assert [each["right"] for each in after["a"]] == [8, 10]
    assert [each["right"] for each in after["b"]] == [2, 10]
    assert [each["only_first"] for each in after["b"]] == [6, 0]
    assert [each["only_this"] for each in after["b"]] == [0, 0]
    assert after["b"][0]["p"] == pytest.approx(binomtest(6, 6).pvalue)
    assert after["b"][1]["p"] == 1.0


@pytest.mark.needs_pybullet
def test_interpreter_and_baselines_answer_after_every_look(tmp_path: Path, shell: Shell) -> None:
    (tmp_path / "small.toml").write_text("[camera]\nsize_px = 64\n")
    typed = ("bench", "looks", "--runs", "2", "--looks", "6", "--views", "30", "--config", tmp_path / "small.toml")
    more = ("--jobs", "1", "--cache", tmp_path / "renders", "--json", tmp_path / "looks.json")
    ended = shell(*typed, *more, "--plot", tmp_path / "pictures")
    assert ended.code in (0, None), ended.err
    assert (tmp_path / "pictures" / "looks.png").is_file()
    found = json.loads((tmp_path / "looks.json").read_text())
    assert list(found["after"]) == ["filter", "nearest", "vote", "sift"]
    assert [len(figures) for figures in found["after"].values()] == [6] * 4
    assert found["after"]["filter"][-1]["right"] == 2  # twins that differ in a whole face, seen from all around


def test_an_unknown_baseline_is_refused(shell: Shell) -> None:
    ended = shell("bench", "looks", "--baselines", "surf")
    assert ended.code == 2
    assert "'surf' is none of nearest, vote, sift" in ended.err
