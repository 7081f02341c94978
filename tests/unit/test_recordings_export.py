"""`viewsep recordings export`: files that others read, whole or not there, and a word about what is missing."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from exported_cameras import (
    SIZE,
    box,
    colmap_cameras,
    nerf_cameras,
    restored,
    simulated_optics,
    true_scene,
)
from golden_recording import GOLDEN, TRUTH, USED, golden, where, with_message, write_as_photos
from scipy.spatial.transform import Rotation
from shell import Shell

from viewsep import messages as m
from viewsep.camera_optics import in_metres
from viewsep.config import Config
from viewsep.errors import BadInput
from viewsep.geometry import angle_between, spherical_direction
from viewsep.learning import learn_view_set
from viewsep.messages import Array
from viewsep.models import library
from viewsep.models.aspect_graph import Provenance
from viewsep.plugins import make_descriptor
from viewsep.recordings.camera_poses import (
    PosedPicture,
    object_pose,
    used_percepts,
)
from viewsep.recordings.export import PictureFormat, Pictures
from viewsep.recordings.export_estimates import export_estimates
from viewsep.recordings.export_scenes import export_bop, export_colmap, export_nerf
from viewsep.recordings.export_views import export_views
from viewsep.sim.view_set import read_view_set


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("views") / "tea"
    assert (
        export_views(golden(), object_pose(golden(), ["product_7", TRUTH], None), out, Pictures(), False).count == USED
    )
    return out


def test_a_view_set_shows_what_was_used_from_the_object_s_frame(views: Path) -> None:
    view_set = read_view_set(views)
    result = golden().messages[where(golden(), "result")[0]].message
    assert isinstance(result, m.Result)
    frames = {frame.stamp_ns: frame for frame in golden().frames}
    for index, (percept, _) in enumerate(used_percepts(golden())):
        assert angle_between(view_set.directions[index], result.rotation.T @ percept.view_direction) < 1e-9
        frame = frames[percept.stamp_ns]
        assert (views / view_set.images[index]).read_bytes() == frame.jpeg
        assert (views / view_set.masks[index]).read_bytes() == frame.mask_png
    assert len(view_set.images) == USED


def test_learn_takes_a_view_set(views: Path, tmp_path: Path, shell: Shell) -> None:
    ended = shell("learn", views, "--jobs", 1, "-o", tmp_path)
    assert (ended.code, ended.err) == (0, "")
    model = library.load(tmp_path / "tea.viewsep")
    assert len(model.directions) == USED
    assert len(model.edges) >= USED - 1


def test_what_is_learned_is_what_was_seen(views: Path) -> None:
    """The features from the recorded JPEGs are nearly those of the percepts."""
    config = restored()[0]
    model, descriptor = learn_view_set(views, "tea", config), make_descriptor(config.descriptor)
    for feature, (percept, _) in zip(model.features, used_percepts(golden()), strict=True):
        assert descriptor.similarity(feature, percept.feature[None])[0] > 0.85


def csv_rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_pictures_from_the_same_direction_are_written_once(tmp_path: Path) -> None:
    used = [percept for percept, _ in used_percepts(golden())]
    again = {used[9].stamp_ns: used[3], used[20].stamp_ns: used[3]}

    def back(event: m.Message) -> m.Message:
        assert isinstance(event, m.PerceptReceived)
        there = again[event.stamp_ns].view_direction
        return m.PerceptReceived(replace(event.percept, view_direction=there))

    changed = golden()
    for index in where(golden(), "percept"):
        message = golden().messages[index].message
        if isinstance(message, m.PerceptReceived) and message.stamp_ns in again:
            changed = with_message(changed, index, back)
    changed = replace(changed, frames=tuple(f for f in golden().frames if f.stamp_ns != used[5].stamp_ns))
    pose = object_pose(changed, [TRUTH], None)
    exported = export_views(changed, pose, tmp_path / "tea", Pictures(), False)
    assert (exported.count, len(csv_rows(tmp_path / "tea" / "views.csv"))) == (USED - 3, USED - 3)
    assert exported.notes[1:] == (
        "1 looks without a recorded picture are left out",
        "2 pictures from directions that others show are left out",
    )
    learn_view_set(tmp_path / "tea", "tea", Config())


def test_pictures_without_masks_are_cut_out_when_learned(tmp_path: Path) -> None:
    bare = replace(golden(), frames=tuple(replace(frame, mask_png=None) for frame in golden().frames))
    export_views(bare, object_pose(bare, [TRUTH], None), tmp_path / "tea", Pictures(), False)
    assert {row["mask"] for row in csv_rows(tmp_path / "tea" / "views.csv")} == {""}
    assert not (tmp_path / "tea" / "masks").exists()
    learn_view_set(tmp_path / "tea", "tea", Config())


def test_too_few_views_are_no_view_set(tmp_path: Path) -> None:
    few = replace(golden(), frames=golden().frames[-2:])
    with pytest.raises(BadInput, match="shows 2 different views of the object, at least 3 make a view set: 33 looks"):
        export_views(few, object_pose(few, [TRUTH], None), tmp_path / "tea", Pictures(), False)
    assert list(tmp_path.iterdir()) == []


def test_the_pose_is_the_named_candidate_s_or_the_best_one_s() -> None:
    names = ["product_7", TRUTH]
    result_at, last = where(golden(), "result")[0], golden().messages[where(golden(), "estimate")[-1]].message
    assert isinstance(last, m.Estimate)
    found = object_pose(golden(), names, None)
    assert (found.name, found.number) == (TRUTH, 2)
    assert (found.rotation == last.candidates[1].rotation).all()
    assert (object_pose(golden(), names, "product_7").rotation == last.candidates[0].rotation).all()
    without = replace(golden(), messages=golden().messages[:result_at])
    assert object_pose(without, names, None).name == TRUTH

    def other(result: m.Message) -> m.Message:
        assert isinstance(result, m.Result)
        return replace(result, object="product_7")

    assert object_pose(with_message(golden(), result_at, other), names, None).name == "product_7"


def test_the_table_has_a_line_per_estimate_and_candidate(tmp_path: Path, shell: Shell) -> None:
    ended = shell("recordings", "export", GOLDEN, "--to", "csv", "-o", tmp_path / "e.csv")
    assert (ended.code, ended.out) == (0, f"66 lines -> {tmp_path / 'e.csv'}\n")
    rows = csv_rows(tmp_path / "e.csv")
    used = used_percepts(golden())
    for number, row in enumerate(rows):
        percept, estimate = used[number // 2]
        candidate = estimate.candidates[number % 2]
        said: dict[str, Any] = {
            key: float(text) if text else None for key, text in row.items() if key not in ("phase", "candidate")
        }
        assert (row["phase"], row["candidate"]) == (estimate.phase, candidate.name)
        assert (said["time_s"], said["iteration"]) == (percept.stamp_ns / 1e9, estimate.iteration)
        assert (said["rating"], said["w0"], said["w2"]) == (candidate.rating, candidate.w0, candidate.w2)
        assert np.isclose(np.radians(said["w1_deg"]), candidate.w1)
        rotation = Rotation.from_quat([said[key] for key in ("qx", "qy", "qz", "qw")]).as_matrix()
        assert np.allclose(rotation, candidate.rotation)
        view = spherical_direction(*np.radians([said["azimuth_deg"], said["elevation_deg"]]))
        assert np.allclose(view, percept.view_direction)
        assert np.isclose(np.radians(said["travel_deg"]), estimate.travel_rad)
        if np.isfinite(candidate.variance):
            assert np.isclose(np.radians(said["spread_deg"]) ** 2, candidate.variance)
        else:
            assert said["spread_deg"] is None
        assert row["probability"] == ""
    assert len(rows) == 66


def test_probabilities_are_in_the_table_with_a_line_for_none_of_them(tmp_path: Path) -> None:
    def rate(message: m.Message) -> m.Message:
        assert isinstance(message, m.Estimate)
        first, second = message.candidates
        return replace(
            message, candidates=(replace(first, probability=0.7), replace(second, probability=0.1)), unknown=0.2
        )

    rated = with_message(golden(), where(golden(), "estimate")[0], rate)
    assert export_estimates(rated, tmp_path / "e.csv", False).count == 67
    rows = csv_rows(tmp_path / "e.csv")
    assert [row["probability"] for row in rows[:4]] == ["0.7", "0.1", "0.2", ""]
    assert [row["candidate"] for row in rows[:4]] == ["product_7", TRUTH, "none of them", "product_7"]
    assert (rows[2]["rating"], rows[2]["spread_deg"], rows[2]["qw"]) == ("", "", "")
    for column in ("time_s", "iteration", "phase", "azimuth_deg", "elevation_deg", "travel_deg"):
        assert rows[2][column] == rows[1][column] != ""


def test_pngs_are_the_decoded_pictures(tmp_path: Path) -> None:
    few = replace(true_scene(), posed=true_scene().posed[:3])
    export_nerf(few, tmp_path / "nerf", Pictures(PictureFormat.PNG), False)
    export_colmap(few, tmp_path / "colmap", Pictures(PictureFormat.PNG), False)
    said = json.loads((tmp_path / "nerf" / "transforms.json").read_text())
    assert not (tmp_path / "nerf" / "masks").exists()
    for number, picture in enumerate(few.posed):
        frame = picture.frame.decode()
        assert set(said["frames"][number]) == {"file_path", "transform_matrix"}
        image = read(tmp_path / "nerf" / said["frames"][number]["file_path"])
        assert (image[..., 2::-1] == frame.image).all()
        assert ((image[..., 3] > 0) == frame.mask).all()
        assert (read(tmp_path / "colmap" / "images" / f"{number:06}.png")[..., ::-1] == frame.image).all()


def read(path: Path) -> Array:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image is not None
    return np.asarray(image)


def test_masks_lie_where_each_program_looks_for_them(tmp_path: Path) -> None:
    few = replace(true_scene(), posed=true_scene().posed[:2])
    export_nerf(few, tmp_path / "nerf", Pictures(), False)
    export_colmap(few, tmp_path / "colmap", Pictures(), False)
    export_bop(replace(few, optics=replace(few.optics, unit="m")), tmp_path / "bop", Pictures(), False)
    second = json.loads((tmp_path / "nerf" / "transforms.json").read_text())["frames"][1]
    for image, mask in (
        (tmp_path / "nerf" / second["file_path"], tmp_path / "nerf" / second["mask_path"]),
        (tmp_path / "colmap/images/000001.jpg", tmp_path / "colmap/masks/000001.jpg.png"),
        (tmp_path / "bop/rgb/000001.jpg", tmp_path / "bop/mask/000001_000000.png"),
    ):
        assert image.read_bytes() == few.posed[1].frame.jpeg
        assert mask.read_bytes() == few.posed[1].frame.mask_png


def test_a_picture_without_a_mask_leaves_out_those_of_the_others_for_nerfs(tmp_path: Path) -> None:
    first, second = true_scene().posed[:2]
    mixed = replace(true_scene(), posed=(first, replace(second, frame=replace(second.frame, mask_png=None))))
    export_nerf(mixed, tmp_path / "nerf", Pictures(), False)
    export_colmap(mixed, tmp_path / "colmap", Pictures(), False)
    export_bop(replace(mixed, optics=replace(mixed.optics, unit="m")), tmp_path / "bop", Pictures(), False)
    frames = json.loads((tmp_path / "nerf" / "transforms.json").read_text())["frames"]
    assert not any("mask_path" in frame for frame in frames)
    assert [path.name for path in (tmp_path / "colmap" / "masks").iterdir()] == ["000000.jpg.png"]
    assert [path.name for path in (tmp_path / "bop" / "mask").iterdir()] == ["000000_000000.png"]


def test_pictures_of_several_sizes_have_intrinsics_of_their_own(tmp_path: Path) -> None:
    small = cv2.imencode(".jpg", np.zeros((30, 40, 3), np.uint8))[1].tobytes()
    first, second, third = true_scene().posed[:3]
    wide = PosedPicture(replace(second.frame, jpeg=small, mask_png=None), (40, 30), second.rotation)
    mixed = replace(true_scene(), posed=(first, wide, third))
    export_nerf(mixed, tmp_path / "nerf", Pictures(), False)
    export_colmap(mixed, tmp_path / "colmap", Pictures(), False)
    for cameras in (nerf_cameras(tmp_path / "nerf"), colmap_cameras(tmp_path / "colmap")):
        assert [camera.matrix[0, 2] for camera in cameras] == [40, 20, 40]
        assert [camera.matrix[1, 2] for camera in cameras] == [40, 15, 40]
        assert np.isclose(cameras[1].matrix[0, 0] * 2, cameras[0].matrix[0, 0])


def test_bop_has_millimetres_and_the_candidate_s_number(tmp_path: Path, shell: Shell) -> None:
    ended = shell("recordings", "export", GOLDEN, "--to", "bop", "-o", tmp_path / "bop", "--json")
    assert ended.code == 0
    assert (ended.json["pictures"], ended.json["to"]) == (66, "bop")
    assert f"obj_id 2 is {TRUTH}" in ended.json["notes"]
    (seen,) = json.loads((tmp_path / "bop" / "scene_gt.json").read_text())["0"]
    assert seen["obj_id"] == 2
    assert seen["cam_t_m2c"][:2] == [0, 0]
    assert np.isclose(seen["cam_t_m2c"][2], simulated_optics().distance * box()[1].radius_m * 1000)
    shell(
        "recordings",
        "export",
        GOLDEN,
        "--to",
        "bop",
        "-o",
        tmp_path / "far",
        "--distance-m",
        "0.5",
        "--as",
        "product_7",
    )
    (seen,) = json.loads((tmp_path / "far" / "scene_gt.json").read_text())["0"]
    assert (seen["cam_t_m2c"], seen["obj_id"]) == ([0.0, 0.0, 500.0], 1)


def test_lengths_are_not_taken_from_another_mesh(product_mesh: Path) -> None:
    model = restored()[1][1]
    assert in_metres(simulated_optics(), model) is not None
    source = model.provenance.source
    for provenance in (
        Provenance("/nowhere/box.obj", model.provenance.source_digest, ""),
        Provenance(source, "0" * 64, ""),
        Provenance(str(product_mesh), model.provenance.source_digest, ""),
    ):
        assert in_metres(simulated_optics(), replace(model, provenance=provenance)) is None


@pytest.fixture(scope="module")
def photos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_as_photos(tmp_path_factory.mktemp("photos") / "a.mcap")


def test_photos_need_their_field_of_view(photos: Path, tmp_path: Path, shell: Shell) -> None:
    export = ("recordings", "export", photos, "-o", tmp_path / "out", "--to")
    ended = shell(*export, "nerf", "--fov-deg", "40", "--json")
    assert ended.code == 0
    camera = nerf_cameras(tmp_path / "out")[0]
    assert np.isclose(camera.matrix[0, 0], SIZE / 2 / np.tan(np.radians(20)))
    assert np.isclose(np.linalg.norm(camera.centre), 1.0)
    assert "lengths are in distances of the camera" in ended.json["notes"][1]
    assert shell(*export, "bop", "--fov-deg", "40", "--distance-m", "0.6", "--force").code == 0
    (seen,) = json.loads((tmp_path / "out" / "scene_gt.json").read_text())["0"]
    assert seen["cam_t_m2c"] == [0.0, 0.0, 600.0]
    assert shell(*export, "views", "--force").code == 0
