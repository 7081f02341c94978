"""A board drawn as a camera would see it on a rig that is known: the rig is found again."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import cv2
import numpy as np
import pytest

from viewsep.calibration.board import Board, RigPlacement, Sighting, placement_of, sight
from viewsep.calibration.lens import Lens
from viewsep.errors import BadInput
from viewsep.geometry import angle_between, axis_rotation
from viewsep.kinematics import RigGeometry, preset
from viewsep.messages import Array, FloatArray

BOARD = Board()
LENS = Lens.seeing(np.radians(30.0), 640, 480)
DISTANCE_M = 0.45
DPI = 300.0
BESIDE_M = np.array([0.012, -0.008, 0.0])  # the board's middle from the axis


def camera_from_world(geometry: RigGeometry) -> tuple[FloatArray, FloatArray]:
    """Rotation (3, 3) and position (3,) of the world in the frame of a camera that looks at the centre."""
    ahead = -geometry.camera_direction
    right = np.cross(ahead, np.array([0.0, 0.0, 1.0]))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    return rotation, rotation @ (-DISTANCE_M * geometry.camera_direction)


def board_in_camera(geometry: RigGeometry, position_rad: Sequence[float]) -> tuple[FloatArray, FloatArray]:
    """Rotation and position of the board, printed side up, beside the axis, turned by 20 degrees."""
    turn, at = camera_from_world(geometry)
    lying = axis_rotation(np.array([0.0, 0.0, 1.0]), np.radians(20.0)) @ np.diag([1.0, -1.0, -1.0])  # y down, z in
    middle = np.array([BOARD.columns, BOARD.rows, 0.0]) * BOARD.square_m / 2
    holder = geometry.holder_rotation(position_rad)
    return turn @ holder @ lying, at + turn @ holder @ (BESIDE_M - lying @ middle)


def drawn(geometry: RigGeometry, position_rad: Sequence[float], seed: int = 0) -> Array:
    """(480, 640) what the camera sees: the board by its homography, a little blur and noise."""
    rotation, position = board_in_camera(geometry, position_rad)
    picture = BOARD.picture(DPI)
    per_m = DPI / 0.0254
    corners = np.array([[0, 0], [BOARD.columns, 0], [BOARD.columns, BOARD.rows], [0, BOARD.rows]]) * BOARD.square_m
    seen = LENS.project(np.pad(corners, ((0, 0), (0, 1))) @ rotation.T + position)
    onto = cv2.getPerspectiveTransform((corners * per_m - 0.5).astype(np.float32), seen.astype(np.float32))
    size = (2 * LENS.width, 2 * LENS.height)  # drawn twice as large: edges as soft as a lens makes them
    larger = np.array([[2.0, 0.0, 0.5], [0.0, 2.0, 0.5], [0.0, 0.0, 1.0]])
    image = cv2.warpPerspective(picture, larger @ onto, size, flags=cv2.INTER_AREA, borderValue=120)
    image = cv2.resize(cv2.GaussianBlur(image, (0, 0), 1.0), (LENS.width, LENS.height), interpolation=cv2.INTER_AREA)
    noisy = image + np.random.default_rng([seed, 3]).normal(0.0, 3.0, image.shape)
    return np.asarray(np.clip(noisy, 0, 255), np.uint8)


def star(geometry: RigGeometry, angles_deg: Sequence[float]) -> list[tuple[float, ...]]:
    """Each joint at all angles, the others at zero."""
    count = len(geometry.limits)
    return [
        tuple(float(np.radians(angle)) if k == joint else 0.0 for k in range(count))
        for joint in range(count)
        for angle in angles_deg
    ]


@cache
def seen(name: str, elevation_deg: float) -> tuple[Sighting, ...]:
    geometry = preset(name, elevation_deg)
    one, several = (0.0, 50.0, 110.0, -60.0, -130.0, 25.0), (0.0, -20.0, -10.0, 10.0, 20.0)
    angles = one if len(geometry.limits) == 1 else several
    looks = [sight(BOARD, drawn(geometry, q, n), q) for n, q in enumerate(star(geometry, angles))]
    return tuple(look for look in looks if look is not None)


def check(found: RigPlacement, geometry: RigGeometry, elevation_deg: float) -> None:
    assert np.degrees(found.camera_elevation_rad) == pytest.approx(elevation_deg, abs=0.25)
    assert np.degrees(angle_between(found.axes, geometry.axes)).max() < 0.3
    assert found.residual_px < 0.6
    assert 0.0 < np.degrees(found.elevation_margin_rad) < 0.3
    assert not found.turns_back


@pytest.mark.parametrize("elevation_deg", [25.0, 55.0])
def test_a_turntable_is_found(elevation_deg: float) -> None:
    found = placement_of(seen("turntable", elevation_deg), LENS)
    check(found, preset("turntable"), elevation_deg)
    assert np.linalg.norm(found.centre_m) == pytest.approx(DISTANCE_M, abs=0.003)
    assert found.pictures == 6


def test_pan_and_tilt_are_found() -> None:
    check(placement_of(seen("pan_tilt", 50.0), LENS), preset("pan_tilt"), 50.0)


def test_an_unknown_lens_is_found_as_well() -> None:
    guess = Lens.seeing(np.radians(38.0), LENS.width, LENS.height)
    found = placement_of(seen("turntable", 55.0), guess, free_lens=True)
    assert found.lens.focal_px == pytest.approx(LENS.focal_px, rel=0.02)
    assert np.degrees(found.camera_elevation_rad) == pytest.approx(55.0, abs=1.0)


def test_objects_centres_lie_higher_than_the_board() -> None:
    found = placement_of(seen("turntable", 25.0), LENS, height_m=0.05)
    camera = DISTANCE_M * np.array([np.cos(np.radians(25.0)), np.sin(np.radians(25.0)) - 0.05 / DISTANCE_M])
    assert np.degrees(found.camera_elevation_rad) == pytest.approx(
        np.degrees(np.arctan2(camera[1], camera[0])), abs=0.3
    )


def test_a_joint_that_turns_the_other_way_is_noticed() -> None:
    back = [Sighting(tuple(-q for q in one.position_rad), one.pixel, one.corner) for one in seen("turntable", 25.0)]
    found = placement_of(back, LENS)
    assert found.turns_back
    assert np.degrees(found.camera_elevation_rad) == pytest.approx(25.0, abs=0.25)
    assert found.axes[0] == pytest.approx([0.0, 0.0, -1.0], abs=0.01)


def test_a_picture_with_the_wrong_angle_is_named() -> None:
    first, *others = seen("turntable", 25.0)
    wrong = Sighting((others[2].position_rad[0] + 0.3,), others[2].pixel, others[2].corner)
    with pytest.raises(BadInput, match="picture 4 fits the others"):
        placement_of([first, *others[:2], wrong, *others[3:]], LENS)


def test_too_few_pictures_or_angles_are_refused() -> None:
    few = seen("turntable", 25.0)
    with pytest.raises(BadInput, match="seen in 3 pictures, at least 4"):
        placement_of(few[:3], LENS)
    near = [Sighting((0.02 * k,), few[0].pixel, few[0].corner) for k in range(6)]
    with pytest.raises(BadInput, match="joint 1 is seen at 6 angles over 6 deg"):
        placement_of(near, LENS)


def test_without_a_board_nothing_is_seen() -> None:
    assert sight(BOARD, np.full((480, 640, 3), 128, np.uint8), (0.0,)) is None


def test_the_picture_to_print_has_its_size() -> None:
    picture = BOARD.picture(300.0, 0.01)
    assert picture.shape == (round(0.12 / 0.0254 * 300), round(0.16 / 0.0254 * 300))
    assert (picture[:50] == 255).all()
    look = sight(BOARD, picture, (0.0,))
    assert look is not None
    assert len(look.pixel) == (BOARD.columns - 1) * (BOARD.rows - 1)
