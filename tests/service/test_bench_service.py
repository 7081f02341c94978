"""`viewsep bench service` measures a real service."""

from __future__ import annotations

import pytest
from shell import Shell

pytest.importorskip("pybullet", reason="needs pybullet, which has wheels for CPython 3.11 only")


@pytest.mark.long
def test_every_figure_is_measured(shell: Shell) -> None:
    ended = shell("bench", "service", "--seconds", 1, "--json")
    assert ended.code == 0, ended.err
    assert set(ended.json) == {
        "status round trip",
        "status round trip, slow viewer",
        "exposure to viewer",
        "command to motion",
    }
    for row in ended.json.values():
        assert 0.0 < row["p50_ms"] <= row["p99_ms"]
        assert row["samples"] >= 10
