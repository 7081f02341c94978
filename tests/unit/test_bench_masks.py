"""`viewsep bench masks`: every scene is tried, figures follow from the looks, and bad masks are counted."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from shell import Shell
from view_sets import ring, write_view_set

from viewsep.bench.masks import ON_DESK, PHOTOS, SCENES, masks_summary


def look(scene: str, sequence: str, iou: float, *, accepted: bool, whole: bool = True) -> dict[str, object]:
    row: dict[str, object] = {"scene": scene, "wrong": False, "sequence": sequence, "index": 0, "iou": iou}
    return row | {"whole": whole, "bad": iou < 0.8 or not whole, "accepted": accepted, "problem": ""}


def test_bad_masks_let_through_are_counted() -> None:
    rows = [look("desk", str(k % 4), 0.9 + 0.001 * k, accepted=True) for k in range(80)]
    rows += [look("desk", "0", 0.5, accepted=True), look("desk", "1", 0.95, accepted=False)]
    rows += [look("desk", "2", 0.9, accepted=False, whole=False), look("desk", "3", 0.1, accepted=False)]
    figures = masks_summary(rows)["desk"]
    assert (figures["looks"], figures["sequences"], figures["bad"], figures["bad_let_through"]) == (84, 4, 3, 1)
    assert figures["bad_let_through_of_accepted"] == pytest.approx(1 / 81)
    assert figures["bad_let_through_of_bad"] == pytest.approx(1 / 3)
    assert (figures["good"], figures["good_refused"]) == (81, 1)
    low, high = figures["iou_median_bootstrap95"]
    assert low <= figures["iou_quantiles"]["0.5"] <= high
    assert figures["iou_quantiles"]["0.5"] == pytest.approx(0.9390, abs=2e-3)


@pytest.mark.needs_pybullet
def test_the_command_tries_every_scene_and_photos(shell: Shell, tmp_path: Path) -> None:
    for seed, name in enumerate(("tin", "tea")):
        write_view_set(tmp_path / "photos" / name, seed, ring(0, 90, 180, 270), size_px=128)
    command = ["bench", "masks", "--runs", "1", "--views", "4", "--capture-every-deg", "90", "--json"]
    run = shell(*command, "--objects", str(tmp_path / "photos"))
    assert run.code == 0, run.err
    said = json.loads(run.out)
    assert {row["scene"] for row in said["looks"]} == {PHOTOS, ON_DESK, *(scene.name for scene in SCENES)}
    assert said["figures"]["desk"]["iou_quantiles"]["0.5"] > 0.9
    assert said["figures"][PHOTOS]["iou_quantiles"]["0.5"] > 0.9
    assert said["figures"]["object is taken away"]["bad"] == 2
    assert said["figures"]["object is taken away"]["bad_let_through"] == 0
