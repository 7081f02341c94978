"""Turns after which an object looks the same are found from pictures, and poses are scored modulo these."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from shell import Shell
from view_sets import ring, write_view_set

from viewsep.bench.setup import Setup
from viewsep.bench.symmetry import Symmetries, Turn, axes_of, symmetries
from viewsep.geometry import axis_rotation, fibonacci_sphere, random_rotation, rotation_angle
from viewsep.messages import FloatArray

X, Y, Z = np.eye(3)


@given(st.integers(0, 10**6))
def test_a_free_axis_leaves_what_no_turn_about_it_can_mend(seed: int) -> None:
    rng = np.random.default_rng(seed)
    true, estimated = random_rotation(rng), random_rotation(rng)
    turns = np.array([axis_rotation(Z, angle) for angle in np.radians(np.arange(0.0, 360.0, 0.5))])
    free = Symmetries((Turn(Z, 0.0),))
    assert free.error(estimated, true) == pytest.approx(rotation_angle(true @ turns, estimated).min(), abs=5e-3)
    flipped = Symmetries((Turn(Z, 0.0), Turn(X, 180.0)))
    both = np.concatenate([turns, turns @ axis_rotation(X, np.pi)])
    assert flipped.error(estimated, true) == pytest.approx(rotation_angle(true @ both, estimated).min(), abs=5e-3)


@given(st.integers(0, 10**6))
def test_single_turns_and_what_follows_from_them_are_no_error(seed: int) -> None:
    rng = np.random.default_rng(seed)
    cube = Symmetries((Turn(X, 90.0), Turn(Z, 90.0)))
    assert len(cube.rotations) == 24
    true, off = random_rotation(rng), axis_rotation(Z, 0.1)
    alike = true @ cube.rotations[rng.integers(24)]
    assert cube.error(alike @ off, true) == pytest.approx(0.1)
    assert Symmetries(()).error(alike, true) == pytest.approx(float(rotation_angle(alike, true)))
    assert Symmetries((Turn(X, 0.0), Turn(Z, 0.0))).error(random_rotation(rng), true) == 0.0  # a ball


def test_the_axes_of_a_turned_box_are_found() -> None:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-2, 2) for z in (-3, 3)], float)
    turn = random_rotation(np.random.default_rng(4))
    found = np.array(axes_of(corners @ turn.T))
    for edge in turn.T:
        assert np.abs(found @ edge).max() == pytest.approx(1.0, abs=1e-6)
    assert len(axes_of(corners * [1.0, 1.0, 0.0])) == 3  # flat


def write_mesh(folder: Path, points: FloatArray, shade: int, lid: int) -> str:
    """The hull of points (N, 3) as a mesh of one grey level, and of another where z is 1."""
    folder.mkdir()
    hull = ConvexHull(points)
    grey = np.where(points[hull.simplices][:, :, 2].min(axis=1) > 0.99, lid, shade)
    cv2.imwrite(str(folder / "map.png"), np.tile(np.arange(256, dtype=np.uint8)[None, :, None], (4, 1, 3)))
    lines = ["mtllib mesh.mtl", "usemtl print"]
    lines += ["v {:.5f} {:.5f} {:.5f}".format(*point) for point in points]
    lines += [f"vt {(level + 0.5) / 256:.5f} 0.5" for level in range(256)]
    lines += ["vn {:.5f} {:.5f} {:.5f}".format(*normal) for normal in hull.equations[:, :3]]
    for index, (corners, level) in enumerate(zip(hull.simplices, grey, strict=True)):
        a, b, c = points[corners]
        outward = np.cross(b - a, c - a) @ hull.equations[index, :3] > 0
        around = corners if outward else corners[::-1]
        lines.append("f " + " ".join(f"{corner + 1}/{level + 1}/{index + 1}" for corner in around))
    (folder / "mesh.obj").write_text("\n".join(lines) + "\n")
    (folder / "mesh.mtl").write_text("newmtl print\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nmap_Kd map.png\n")
    return str(folder)


def prism(sides: int) -> FloatArray:
    around = np.arange(sides) * 2 * np.pi / sides
    ring_xy = 0.5 * np.stack([np.cos(around), np.sin(around)], axis=1)
    return np.array([[x, y, z] for z in (-1.0, 1.0) for x, y in ring_xy])


@pytest.mark.needs_pybullet
@pytest.mark.parametrize(
    ("name", "points", "lid", "alike", "free"),
    [
        pytest.param("can", prism(60), 120, 2, 1, marks=pytest.mark.long),  # upside down too
        pytest.param("ball", fibonacci_sphere(300), 120, 1, 2, marks=pytest.mark.long),
        ("beam", prism(4), 120, 8, 0),
        ("post", prism(4), 250, 4, 0),
    ],
)
def test_plain_bodies_have_their_symmetries(
    tmp_path: Path, name: str, points: FloatArray, lid: int, alike: int, free: int
) -> None:
    found = symmetries(write_mesh(tmp_path / name, points, 120, lid), Setup())
    assert len(found.axes) == free
    if free < 2:
        assert len(found.rotations) == alike
        assert any(abs(turn.axis @ Z) > 0.999 and turn.degrees in (0.0, 90.0) for turn in found.turns)


@pytest.mark.needs_pybullet
def test_print_makes_every_side_of_a_box_a_different_one() -> None:
    assert symmetries("generated:1", Setup()).turns == ()
    assert symmetries("generated:1", Setup()) is symmetries("generated:1", Setup(views=30))


@pytest.mark.needs_pybullet
def test_photos_tell_of_turns_about_the_vertical(tmp_path: Path, shell: Shell) -> None:
    write_view_set(tmp_path / "photos" / "tea", 1, ring(*range(0, 360, 10)))
    ended = shell("bench", "symmetries", "--objects", tmp_path / "photos", "--jobs", "1", "--cache-mb", "0", "--json")
    assert ended.code in (0, None), ended.err
    assert ended.json == {"tea": []}
    assert "tea" in shell("bench", "symmetries", "--objects", tmp_path / "photos", "--jobs", "1", "--cache-mb", "0").out
