"""From a folder of photos to an answer, a replay and a picture: the same commands as for meshes, and no physics."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from seed_method import SEED_OPTIONS
from shell import Shell
from view_sets import ring, write_view_set

from viewsep.models.library import load
from viewsep.recordings.reader import read_recording


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders `tea` and `decaf` with rings of photos, a few missing in one of them."""
    folder = tmp_path_factory.mktemp("photos")
    write_view_set(folder / "tea", 1, ring(*range(0, 360, 5)))
    write_view_set(folder / "decaf", 2, ring(*(a for a in range(0, 360, 5) if a not in (35, 120))), masks=False)
    return folder


@pytest.fixture
def lib(photos: Path, tmp_path: Path, shell: Shell) -> Path:
    assert shell("learn", photos / "tea", photos / "decaf", "--every", "4", "-o", tmp_path / "lib")[0] == 0
    return tmp_path / "lib"


def test_learn_takes_every_kth_photo(photos: Path, lib: Path) -> None:
    tea = load(lib / "tea.viewsep")
    assert (len(tea.directions), len(tea.edges)) == (18, 18)
    assert tea.provenance.source == str((photos / "tea").resolve())


def test_learn_takes_named_photos_and_says_what_it_wrote(photos: Path, tmp_path: Path, shell: Shell) -> None:
    nodes = tmp_path / "nodes.txt"
    nodes.write_text("v000.png\nv004.png # side\nv008.png\nv012.png\n")
    code, out, _ = shell("learn", photos / "tea", "--nodes", nodes, "--name", "box", "-o", tmp_path / "lib", "--json")
    assert code == 0
    (row,) = json.loads(out)
    assert (row["name"], row["views"]) == ("box", 4)


@pytest.mark.parametrize("truth", ["tea", "decaf"])
def test_separate_tells_photographed_objects_apart_and_the_recording_repeats(
    truth: str, lib: Path, tmp_path: Path, shell: Shell
) -> None:
    run = tmp_path / "run.mcap"
    code, out, err = shell("separate", "--models", lib, "--truth", truth, "--seed", 3, "--record", run, "--json")
    answer = json.loads(out)
    assert (code, answer["object"], answer["correct"]) == (0, truth, True), out
    assert answer["simulated"] is True
    assert answer["pictures"] == "photos"
    assert err == ""
    recorded: dict[str, Any] = json.loads(read_recording(run).metadata["config"]["json"])
    assert recorded["rig"]["backend"] == "photos"
    assert len(recorded["rig"]["views_deg"]) == {"tea": 54, "decaf": 52}[truth]
    code, out, _ = shell("replay", run, "--verify", "--from-frames", "--models", lib, "--json")
    assert code == 0
    found = json.loads(out)
    assert found["decisions"]["exact"] is True
    assert found["frames"]["percepts"] >= answer["looks"]
    assert shell("report", run, "-o", tmp_path / "run.png")[0] == 0
    assert (tmp_path / "run.png").stat().st_size > 10_000


def test_people_are_told_that_the_pictures_are_photos(lib: Path, shell: Shell) -> None:
    _, out, _ = shell("separate", "--models", lib, "--truth", "tea", "--seed", 3)
    assert "(simulated rig, photos)" in " ".join(out.split())


def test_a_model_of_all_photos_sees_those_again_and_this_is_said(photos: Path, tmp_path: Path, shell: Shell) -> None:
    assert shell("learn", photos / "tea", photos / "decaf", "-o", tmp_path / "lib")[0] == 0
    code, out, err = shell("separate", "--models", tmp_path / "lib", "--truth", "tea", "--seed", 3, "--json")
    assert code in (0, 3, 5)
    assert json.loads(out)["pictures"] == "photos the model was learned from"
    assert "note: no photos were left out of the model" in err


def test_any_folder_of_photos_can_be_held(lib: Path, tmp_path: Path, shell: Shell) -> None:
    dome = [(float(a), float(e)) for e in (0, 20, 40) for a in range(0, 360, 20)]
    other = write_view_set(tmp_path / "coffee", 3, dome)
    config = tmp_path / "short.toml"
    config.write_text("[task]\nmax_looks = 8\n")
    run = tmp_path / "run.mcap"
    typed = (
        "separate",
        "--models",
        lib,
        "--object",
        other,
        "--config",
        config,
        "--record",
        run,
        "--json",
        *SEED_OPTIONS,
    )
    code, out, _ = shell(*typed)
    answer = json.loads(out)
    assert code == 3
    assert (answer["truth"], answer["correct"], answer["pictures"]) == (None, None, "photos")
    rig = json.loads(read_recording(run).metadata["config"]["json"])["rig"]
    assert [joint["name"] for joint in rig["joints"]] == ["tilt", "pan"]
    assert len(rig["views_deg"]) == 54
    assert shell("replay", run, "--verify", "--from-frames")[0] == 0


@pytest.mark.shared
@pytest.mark.parametrize("truth", ["obj005", "obj032"])
def test_photographed_products_are_told_apart(truth: str, shared: Path, tmp_path: Path, shell: Shell) -> None:
    sources = [shared / "photos" / "coil100" / name for name in ("obj005", "obj032")]
    assert shell("learn", *sources, "--every", "4", "-o", tmp_path / "lib")[0] == 0
    code, out, _ = shell("separate", "--models", tmp_path / "lib", "--truth", truth, "--seed", 1, "--json")
    assert code == 0, out
    assert np.isfinite(json.loads(out)["pose_error_deg"])
