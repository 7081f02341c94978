"""`viewsep recordings export`: what cannot be done is said in one sentence, and nothing is left half-written."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from exported_cameras import (
    restored,
    true_scene,
)
from golden_recording import GOLDEN, TRUTH, golden, with_metadata, write, write_as_photos
from shell import Shell

from viewsep.errors import BadInput, BadRecording
from viewsep.models import library
from viewsep.models.aspect_graph import Provenance
from viewsep.recordings.export import PictureFormat, Pictures, whole_folder
from viewsep.recordings.export_scenes import export_nerf


@pytest.fixture(scope="module")
def gone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of an object whose mesh is not there any more."""
    other = replace(restored()[1][1], provenance=Provenance("/nowhere/box.obj", "0" * 64, ""))
    changed = with_metadata(golden(), "models", **{TRUTH: other.digest})
    attachments = {**golden().attachments, f"{TRUTH}.viewsep": library.to_bytes(other)}
    return write(changed, tmp_path_factory.mktemp("gone") / "a.mcap", attachments, pictures=range(60, 66))


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_as_photos(tmp_path_factory.mktemp("photos") / "a.mcap")


BAD = {
    "fov of a simulated camera": ("--to nerf --fov-deg 30", "the recording's camera is the simulated one with 20"),
    "fov out of range": ("--to nerf --fov-deg 180", "--fov-deg 180: give an angle of 0.1 to 170 degrees"),
    "fov is no number": ("--to colmap --fov-deg nan", "--fov-deg nan: give an angle"),
    "distance 0": ("--to colmap --distance-m 0", "--distance-m 0: give metres above 0"),
    "infinite distance": ("--to bop --distance-m inf", "--distance-m inf: give metres above 0"),
    "fov of views": (
        "--to views --fov-deg 30",
        "--fov-deg and --distance-m go with nerf, colmap, bop, not with --to views",
    ),
    "distance of csv": ("--to csv --distance-m 1", "go with nerf, colmap, bop, not with --to csv"),
    "pictures of csv": ("--to csv --pictures png", "--as and --pictures do not go with --to csv"),
    "candidate of csv": ("--to csv --as product_7", "--as and --pictures do not go with --to csv"),
    "unknown candidate": (
        "--to nerf --as tea",
        f"'tea' is no candidate of the recording: choose one of product_7, {TRUTH}",
    ),
    "unknown kind": ("--to obj", "'obj' is not one of"),
    "no kind": ("", "Missing option"),
    "unknown format": ("--to views --pictures gif", "'gif' is not one of"),
}


@pytest.mark.parametrize(("typed", "words"), BAD.values(), ids=BAD.keys())
def test_options_that_make_no_sense_are_refused(typed: str, words: str, tmp_path: Path, shell: Shell) -> None:
    ended = shell("recordings", "export", GOLDEN, *typed.split(), "-o", tmp_path / "out")
    assert (ended.code, ended.out) == (2, "")
    assert words in " ".join(ended.err.replace("│", " ").split())
    assert list(tmp_path.iterdir()) == []


def test_what_photos_do_not_know_must_be_given(photos: Path, tmp_path: Path, shell: Shell) -> None:
    ended = shell("recordings", "export", photos, "--to", "colmap", "-o", tmp_path / "out")
    assert ended.code == 2
    assert "shows photos and does not know their lens: give --fov-deg" in ended.err
    ended = shell("recordings", "export", photos, "--to", "bop", "--fov-deg", "40", "-o", tmp_path / "out")
    assert ended.code == 2
    assert "--to bop needs lengths, and the recording shows photos: give --distance-m" in ended.err


def test_a_mesh_that_is_gone_has_no_size(gone: Path, tmp_path: Path, shell: Shell) -> None:
    export = ("recordings", "export", gone, "-o", tmp_path / "out", "--to")
    ended = shell(*export, "bop")
    assert ended.code == 2
    assert (
        f"the mesh that {TRUTH} was learned from (/nowhere/box.obj) is not there any more: give --distance-m"
        in ended.err
    )
    assert shell(*export, "bop", "--distance-m", "1").code == 0
    assert shell(*export, "nerf", "--force").code == 0


@pytest.mark.parametrize("kind", ["views", "csv", "nerf", "colmap", "bop"])
def test_nothing_is_replaced_unasked(kind: str, photos: Path, tmp_path: Path, shell: Shell) -> None:
    out = tmp_path / "out"
    scene = ["--fov-deg", "40", "--distance-m", "1"] if kind in ("nerf", "colmap", "bop") else []
    export: tuple[str | Path, ...] = ("recordings", "export", photos, "--to", kind, "-o", out, *scene)
    assert shell(*export).code == 0
    first = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    ended = shell(*export)
    assert (ended.code, ended.out) == (2, "")
    assert f"{out}: exists already; choose another name, or replace it with --force" in ended.err
    assert shell(*export, "--force").code == 0
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == first


def test_force_replaces_exports_only(photos: Path, tmp_path: Path, shell: Shell) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "thesis.tex").write_text("years")
    export = ("recordings", "export", photos, "--to", "views", "--force", "-o")
    ended = shell(*export, out)
    assert ended.code == 2
    assert f"{out}: holds 'thesis.tex', which no export made" in ended.err
    assert (out / "thesis.tex").read_text() == "years"
    ended = shell(*export, out / "thesis.tex")
    assert ended.code == 2
    assert "is no folder, so --force does not replace it" in ended.err
    ended = shell("recordings", "export", photos, "--to", "csv", "--force", "-o", out)
    assert ended.code == 2
    assert "is a folder; give the name of a file" in ended.err


@pytest.mark.parametrize("kind", ["views", "csv"])
def test_the_folder_around_must_be_there(kind: str, tmp_path: Path, shell: Shell) -> None:
    ended = shell("recordings", "export", GOLDEN, "--to", kind, "-o", tmp_path / "no" / "out")
    assert ended.code == 2
    assert f"the folder {tmp_path / 'no'} does not exist; create it" in ended.err
    assert list(tmp_path.iterdir()) == []


def test_a_folder_needs_a_name(tmp_path: Path, shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for out in (".", ".."):
        ended = shell("recordings", "export", GOLDEN, "--to", "views", "--force", "-o", out)
        assert ended.code == 2
        assert f"--output {out}: give the name of a new folder" in ended.err


def test_nothing_half_written_is_left(tmp_path: Path) -> None:
    first, second = true_scene().posed[:2]
    damaged = replace(second, frame=replace(second.frame, jpeg=second.frame.jpeg[:20]))
    with pytest.raises(BadRecording, match="neither JPEG nor PNG"):
        export_nerf(replace(true_scene(), posed=(first, damaged)), tmp_path / "out", Pictures(PictureFormat.PNG), False)
    assert list(tmp_path.iterdir()) == []


def test_an_export_that_fails_keeps_the_one_before(tmp_path: Path) -> None:
    out = tmp_path / "out"
    with whole_folder(out, False) as folder:
        (folder / "views.csv").write_text("old")
    with (
        pytest.raises(BadInput, match=r"cannot be written \(No space left on device\); make room"),
        whole_folder(out, True) as folder,
    ):
        raise OSError(28, "No space left on device", folder / "views.csv")
    assert (out / "views.csv").read_text() == "old"
    assert list(tmp_path.iterdir()) == [out]


def test_what_a_killed_export_left_is_named(tmp_path: Path) -> None:
    part = tmp_path / "out.part"
    (part / "images").mkdir(parents=True)
    words = r"out\.part: is left from an export that was broken off; remove it, or replace"
    with pytest.raises(BadInput, match=words), whole_folder(tmp_path / "out", False):
        pass
    with whole_folder(tmp_path / "out", True) as folder:
        (folder / "views.csv").touch()
    assert [path.name for path in tmp_path.rglob("*")] == ["out", "views.csv"]


def test_a_recording_without_estimates_has_no_pose(tmp_path: Path, shell: Shell) -> None:
    nothing = replace(golden(), messages=golden().messages[:50])
    path = write(nothing, tmp_path / "a.mcap")
    for kind, words in (("views", "so no pose of the object is known"), ("csv", "holds no estimates")):
        ended = shell("recordings", "export", path, "--to", kind, "-o", tmp_path / "out")
        assert ended.code == 2
        assert words in ended.err
    assert not (tmp_path / "out").exists()


def test_a_damaged_recording_is_refused(tmp_path: Path, shell: Shell) -> None:
    shutil.copy(GOLDEN, tmp_path / "a.mcap")
    with (tmp_path / "a.mcap").open("r+b") as file:
        file.truncate(500_000)
    ended = shell("recordings", "export", tmp_path / "a.mcap", "--to", "views", "-o", tmp_path / "out")
    assert ended.code == 2
    assert "truncated" in ended.err
