"""The camera's poses in exports are what the kinematics say, in every convention, with the roll."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from exported_cameras import (
    SIZE,
    Camera,
    bop_cameras,
    box,
    colmap_cameras,
    nerf_cameras,
    restored,
    simulated_optics,
    true_scene,
)
from golden_recording import USED, golden, where
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from viewsep import messages as m
from viewsep.config import geometry_of
from viewsep.errors import BadInput
from viewsep.geometry import random_rotation, spherical_direction, unit
from viewsep.kinematics import PRESETS, preset
from viewsep.messages import BoolArray, FloatArray
from viewsep.perception import position_at
from viewsep.recordings.camera_poses import (
    ObjectPose,
    camera_axes,
    posed_pictures,
    used_percepts,
)
from viewsep.recordings.codec import RecordedFrame
from viewsep.recordings.export import Pictures
from viewsep.recordings.export_scenes import Scene, export_bop, export_colmap, export_nerf, scene_of
from viewsep.recordings.reader import Recorded, Recording
from viewsep.sim.render import CameraOptics
from viewsep.sim.source import open_renderer

POINT = np.array([0.3, -0.2, 0.4])  # anywhere in the object


Write = Callable[[Scene, Path, Pictures, bool], object]
CAMERAS: dict[str, tuple[Write, Callable[[Path, float], list[Camera]]]] = {
    "nerf": (export_nerf, lambda folder, _: nerf_cameras(folder)),
    "colmap": (export_colmap, lambda folder, _: colmap_cameras(folder)),
    "bop": (export_bop, bop_cameras),
}


@pytest.fixture(scope="module")
def cameras(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Camera]]:
    """What the exports say of the cameras, lengths in radii of the object."""
    folder, radius_m = tmp_path_factory.mktemp("true"), box()[1].radius_m
    metric = replace(true_scene().optics, distance=true_scene().optics.distance * radius_m, unit="m")
    found = {}
    for kind, (write_scene, read_scene) in CAMERAS.items():
        scene = replace(true_scene(), optics=metric) if kind == "bop" else true_scene()
        write_scene(scene, folder / kind, Pictures(), False)
        found[kind] = read_scene(folder / kind, radius_m * 1000)
    return found


def silhouette(pixels: FloatArray) -> BoolArray:
    """(SIZE, SIZE) mask of a convex body whose points fall on (N, 2) pixels."""
    fine = 16
    mask = np.zeros((SIZE * fine, SIZE * fine), np.uint8)
    cv2.fillConvexPoly(mask, cv2.convexHull(np.round(pixels * fine).astype(np.int32)), 1)
    return np.asarray(cv2.resize(mask.astype(np.float32), (SIZE, SIZE), interpolation=cv2.INTER_AREA) >= 0.5)


def overlap(a: BoolArray, b: BoolArray) -> float:
    return float((a & b).sum() / (a | b).sum())


@pytest.mark.parametrize("kind", CAMERAS)
def test_the_box_falls_on_its_recorded_silhouette(kind: str, cameras: dict[str, list[Camera]]) -> None:
    """Roll, view, field of view and distance are right: a box rolled by 5 degrees more would overlap by 0.93."""
    overlaps, rolled = [], []
    for camera, frame in zip(cameras[kind], golden().frames, strict=True):
        mask = frame.decode().mask
        assert mask is not None
        overlaps.append(overlap(silhouette(camera.project(box()[0])), mask))
        roll = Rotation.from_euler("z", 5, degrees=True).as_matrix()
        turned = camera._replace(rotation=roll @ camera.rotation)
        rolled.append(overlap(silhouette(turned.project(box()[0])), mask))
    assert min(overlaps) > 0.96
    assert np.mean(overlaps) > 0.98
    assert np.mean(rolled) < 0.95


def test_all_exports_have_the_same_cameras(cameras: dict[str, list[Camera]]) -> None:
    for nerf, colmap, bop in zip(*(cameras[kind] for kind in ("nerf", "colmap", "bop")), strict=True):
        for other in (colmap, bop):
            assert np.allclose(nerf.centre, other.centre, atol=1e-12)
            assert np.allclose(nerf.axis, other.axis, atol=1e-12)
            assert np.allclose(nerf.project(POINT[None]), other.project(POINT[None]), atol=1e-9)


def test_cameras_are_where_the_percepts_say(cameras: dict[str, list[Camera]]) -> None:
    percepts = {
        r.message.stamp_ns: r.message.percept for r in golden().messages if isinstance(r.message, m.PerceptReceived)
    }
    for camera, picture in zip(cameras["nerf"], true_scene().posed, strict=True):
        seen_from = true_scene().pose.rotation.T @ percepts[picture.frame.stamp_ns].view_direction
        assert np.allclose(camera.centre, true_scene().optics.distance * seen_from, atol=1e-12)
        assert np.allclose(camera.axis, -seen_from, atol=1e-12)
        assert np.allclose(camera.project(np.zeros((1, 3))), SIZE / 2)


def frame_at(stamp_ns: int) -> RecordedFrame:
    return replace(golden().frames[0], stamp_ns=stamp_ns)


def recording_of(frames: tuple[RecordedFrame, ...], states: tuple[m.JointState, ...]) -> Recording:
    recorded = tuple(Recorded("motion/state", state.stamp_ns, state, b"") for state in states)
    return Recording({}, {}, recorded, frames)


@given(
    name=st.sampled_from(sorted(PRESETS)),
    elevation=st.floats(-89, 89),
    seed=st.integers(0, 1000),
    share=st.floats(0, 1),
)
def test_a_point_is_seen_where_the_kinematics_put_it(name: str, elevation: float, seed: int, share: float) -> None:
    """The object turns with the holder before an upright camera: projected without any rotation of a camera's frame."""
    geometry = preset(name, elevation)
    rng = np.random.default_rng(seed)
    grasp = random_rotation(rng)
    before, after = rng.uniform(-1.0, 1.0, (2, len(geometry.limits)))
    states = (m.JointState(0, tuple(before), (), True), m.JointState(1_000_000, tuple(after), (), True))
    stamp_ns = round(share * 1_000_000)
    (posed,) = posed_pictures(recording_of((frame_at(stamp_ns),), states), geometry, grasp)
    joints = before + stamp_ns / 1_000_000 * (after - before)
    point = geometry.holder_rotation(joints.tolist()) @ grasp @ POINT
    camera = geometry.camera_direction
    assert np.allclose(posed.view_direction, grasp.T @ geometry.view_direction(joints.tolist()), atol=1e-9)
    right = np.array([-camera[1], camera[0], 0.0])  # horizontal
    up = np.array([0.0, 0.0, 1.0]) - camera[2] * camera
    if abs(camera[2]) < 0.99:
        expected = [point @ unit(right), -(point @ unit(up)), -(point @ camera)]
        assert np.allclose(posed.rotation @ POINT, expected, atol=1e-9)
    assert np.allclose(posed.rotation @ posed.rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(posed.rotation) > 0


def test_photos_of_a_standing_object_are_upright() -> None:
    """On the plate over photos tilt is the elevation and pan the azimuth backwards."""
    azimuth, elevation = np.radians([130.0, 40.0])
    states = tuple(m.JointState(stamp, (elevation, -azimuth), (), False) for stamp in (0, 10))
    (posed,) = posed_pictures(recording_of((frame_at(5),), states), preset("gimbal"), np.eye(3))
    assert np.allclose(posed.view_direction, spherical_direction(azimuth, elevation))
    right, down = posed.rotation[:2]
    assert np.isclose(right[2], 0.0)
    assert np.isclose(down[2], -np.cos(elevation))


@pytest.mark.parametrize("z", [1.0, -1.0])
def test_a_camera_straight_above_or_below_has_axes_too(z: float) -> None:
    axes = camera_axes(np.array([0.0, 0.0, z]))
    assert np.allclose(axes @ axes.T, np.eye(3))
    assert np.isclose(np.linalg.det(axes), 1.0)
    assert np.allclose(axes[2], [0, 0, -z])


@pytest.mark.needs_pybullet
@pytest.mark.parametrize("direction", [(0.3, 0.4, 0.5), (0.0, 0.0, 1.0), (0.05, 0.0, -1.0), (-1.0, 0.2, 0.0)])
def test_the_simulated_camera_has_these_axes(direction: tuple[float, float, float]) -> None:
    camera, rotation = unit(np.array(direction)), random_rotation(np.random.default_rng(3))
    optics = simulated_optics()
    renderer = open_renderer("generated:7:twin=face", CameraOptics(SIZE))
    _, mask = renderer.render(camera, rotation)
    renderer.close()
    f = optics.focal_px(SIZE)
    matrix = np.array([[f, 0, SIZE / 2], [0, f, SIZE / 2], [0, 0, 1]])
    seen = Camera(camera_axes(camera) @ rotation, np.array([0, 0, optics.distance]), matrix)
    assert overlap(silhouette(seen.project(box()[0])), mask) > 0.96


def test_pictures_without_joint_angles_are_left_out() -> None:
    states = (m.JointState(10, (0.0, 0.0), (), False), m.JointState(20, (0.1, 0.0), (), False))
    frames = tuple(frame_at(stamp) for stamp in (9, 10, 15, 20, 21))
    posed = posed_pictures(recording_of(frames, states), preset("gimbal"), np.eye(3))
    assert [picture.frame.stamp_ns for picture in posed] == [10, 15, 20]
    with pytest.raises(BadInput, match="no pictures with joint angles around them"):
        scene_of(recording_of(frames[:1], states), preset("gimbal"), ObjectPose("a", 1, np.eye(3)), simulated_optics())


def test_angles_are_interpolated_as_perception_does_it() -> None:
    history = [r.message for r in golden().messages if isinstance(r.message, m.JointState)]
    geometry = geometry_of(restored()[0].rig)
    for picture in posed_pictures(golden(), geometry, np.eye(3))[::9]:
        position = position_at(picture.frame.stamp_ns, history)
        assert np.allclose(
            picture.rotation, camera_axes(geometry.camera_direction) @ geometry.holder_rotation(list(position))
        )


def test_used_percepts_are_those_that_gave_an_estimate() -> None:
    used = used_percepts(golden())
    assert len(used) == USED
    assert [estimate.iteration for _, estimate in used] == list(range(1, USED + 1))
    assert all(percept.stamp_ns == estimate.stamp_ns for percept, estimate in used)
    last = golden().messages[where(golden(), "estimate")[-1]]
    ended = (Recorded("event", 1, m.DeadlinePassed(1), b""), last)  # the last estimate is told again with the result
    assert len(used_percepts(replace(golden(), messages=(*golden().messages, *ended)))) == USED
