"""Every rig finds joint angles for the views it can show, refuses the others, and stays close to where it is."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from viewsep.errors import BadConfig, UnreachableView
from viewsep.geometry import angle_between, azimuth_elevation, fibonacci_sphere, spherical_direction
from viewsep.interfaces import JointLimits
from viewsep.kinematics import PRESETS, RigGeometry, preset, reachable_directions, rig_geometry
from viewsep.messages import FloatArray

EVERY_PRESET = pytest.mark.parametrize("name", PRESETS)
TOLERANCE_RAD = math.radians(0.05)
LIMIT = JointLimits("pan", -1.0, 1.0, 1.0)


@cache
def rig(name: str) -> RigGeometry:
    return preset(name)


def bounds(geometry: RigGeometry, turns: float = 1.0) -> tuple[FloatArray, FloatArray]:
    """Limits of the joints, free ones over some turns."""
    lower = np.array([max(limit.lower_rad, -turns * 2 * np.pi) for limit in geometry.limits])
    upper = np.array([min(limit.upper_rad, turns * 2 * np.pi) for limit in geometry.limits])
    return lower, upper


def shares(count: int = 3) -> st.SearchStrategy[list[float]]:
    """Where in the range of each joint: 0 at its lower limit, 1 at the upper one."""
    return st.lists(st.floats(0.0, 1.0), min_size=count, max_size=count)


def joints(geometry: RigGeometry, share: list[float]) -> FloatArray:
    lower, upper = bounds(geometry)
    return lower + np.array(share[: len(lower)]) * (upper - lower)


def assert_shows(geometry: RigGeometry, position_rad: tuple[float, ...], view: FloatArray) -> None:
    assert float(angle_between(geometry.view_direction(position_rad), view)) <= TOLERANCE_RAD
    for angle, limit in zip(position_rad, geometry.limits, strict=True):
        assert limit.lower_rad - 1e-9 <= angle <= limit.upper_rad + 1e-9


@EVERY_PRESET
@given(share=shares())
def test_the_view_follows_the_designs_formula(name: str, share: list[float]) -> None:
    geometry = rig(name)
    q = joints(geometry, share)
    product = Rotation.identity()
    for axis, angle in zip(geometry.axes, q, strict=True):
        product = product * Rotation.from_rotvec(axis * angle)
    np.testing.assert_allclose(geometry.holder_rotation(q.tolist()), product.as_matrix(), atol=1e-12)
    expected = product.as_matrix().T @ geometry.camera_direction
    np.testing.assert_allclose(geometry.view_direction(q.tolist()), expected, atol=1e-12)
    np.testing.assert_allclose(geometry.view_directions(q[None])[0], expected, atol=1e-12)


@EVERY_PRESET
def test_at_zero_the_view_is_the_camera_at_azimuth_zero(name: str) -> None:
    geometry = rig(name)
    view = geometry.view_direction([0.0] * len(geometry.limits))
    assert np.degrees(azimuth_elevation(view)) == pytest.approx((0.0, PRESETS[name][2]), abs=1e-9)


def test_the_cameras_elevation_can_be_overridden() -> None:
    view = preset("turntable", 40.0).view_direction([1.0])
    assert np.degrees(azimuth_elevation(view)) == pytest.approx((-math.degrees(1.0), 40.0))


@EVERY_PRESET
@given(share=shares())
def test_the_jacobian_is_the_derivative_of_the_view(name: str, share: list[float]) -> None:
    geometry = rig(name)
    q = joints(geometry, share)
    _, jacobian = geometry._views_and_jacobian(q[None])
    small = 1e-6 * np.eye(len(q))
    numeric = (geometry.view_directions(q + small) - geometry.view_directions(q - small)).T / 2e-6
    np.testing.assert_allclose(jacobian[0], numeric, atol=1e-8)


@EVERY_PRESET
@settings(max_examples=60)
@given(share=shares(), near_share=shares())
def test_joints_are_found_for_every_view_the_joints_can_show(
    name: str, share: list[float], near_share: list[float]
) -> None:
    geometry = rig(name)
    view = geometry.view_direction(joints(geometry, share).tolist())
    assert_shows(geometry, geometry.joints_for(view, joints(geometry, near_share).tolist()), view)


@EVERY_PRESET
def test_many_views_at_once_are_reached_exactly_where_joints_are_found(name: str) -> None:
    geometry, views = rig(name), np.concatenate([fibonacci_sphere(60), reachable_directions(rig(name), 60)[:40]])
    reached = geometry.reaches(views)
    for view, is_reached in zip(views, reached, strict=True):
        assert geometry.reaches(view) == is_reached
        if is_reached:
            assert_shows(geometry, geometry.joints_for(view, geometry.home()), view)
        else:
            with pytest.raises(UnreachableView):
                geometry.joints_for(view, geometry.home())
    assert reached[60:].all()
    assert reached[:60].all() == (name == "gimbal")


@EVERY_PRESET
def test_every_reachable_direction_has_joints(name: str) -> None:
    geometry = rig(name)
    views = reachable_directions(geometry)
    home = [0.0] * len(geometry.limits)
    for view in views[:: max(1, len(views) // 400)]:
        assert_shows(geometry, geometry.joints_for(view, home), view)


@EVERY_PRESET
@given(share=shares())
def test_reachable_directions_leave_no_gap(name: str, share: list[float]) -> None:
    geometry = rig(name)
    view = geometry.view_direction(joints(geometry, share).tolist())
    assert np.degrees(angle_between(_directions(name), view).min()) < 6.0


@cache
def _directions(name: str) -> FloatArray:
    return reachable_directions(rig(name))


def test_a_turntable_shows_one_ring() -> None:
    views = _directions("turntable")
    np.testing.assert_allclose(views[:, 2], math.sin(math.radians(25.0)), atol=1e-12)
    azimuth = np.sort([azimuth_elevation(view)[0] for view in views])
    gaps_deg = np.degrees(np.diff([*azimuth, azimuth[0] + 2 * np.pi]))
    assert len(views) == 180
    np.testing.assert_allclose(gaps_deg, 2.0, atol=1e-6)


def test_a_limited_turntable_shows_an_arc_with_both_ends() -> None:
    limit = JointLimits("pan", math.radians(-30.0), math.radians(45.0), 1.0)
    views = reachable_directions(rig_geometry("arc", [[0, 0, 1]], [limit], 10.0))
    azimuth_deg = np.degrees([azimuth_elevation(view)[0] for view in views])
    assert azimuth_deg.min() == pytest.approx(-45.0)
    assert azimuth_deg.max() == pytest.approx(30.0)


def test_the_gimbal_shows_the_whole_sphere() -> None:
    geometry = rig("gimbal")
    for view in [*fibonacci_sphere(60), *np.eye(3), *-np.eye(3)]:
        assert_shows(geometry, geometry.joints_for(view, (0.0, 0.0)), view)


UNREACHABLE = {
    "turntable, above its ring": ("turntable", spherical_direction(1.0, math.radians(26.0))),
    "turntable, just off its ring": ("turntable", spherical_direction(-2.0, math.radians(24.8))),
    "turntable, from below": ("turntable", -np.eye(3)[2]),
    "pan_tilt, from straight above": ("pan_tilt", np.eye(3)[2]),
    "pan_tilt, beyond its tilt": ("pan_tilt", spherical_direction(0.5, math.radians(80.5))),
}


@pytest.mark.parametrize(("name", "view"), UNREACHABLE.values(), ids=UNREACHABLE.keys())
def test_an_unreachable_view_is_refused_by_the_rigs_name(name: str, view: FloatArray) -> None:
    geometry = rig(name)
    with pytest.raises(UnreachableView, match=rf"rig '{name}' cannot show the view \(.*\) within its joint limits"):
        geometry.joints_for(view, [0.3] * len(geometry.limits))


def test_views_the_wrist_cannot_show_are_refused_wherever_it_is() -> None:
    geometry, views = rig("wrist"), fibonacci_sphere(500)
    gap = angle_between(views[:, None], _directions("wrist")[None]).min(axis=1)
    beyond = views[gap > math.radians(8.0)]
    assert len(beyond) > 0
    for view in beyond:
        for near in ((0.0, 0.0, 0.0), (0.9, -1.2, 2.5)):
            with pytest.raises(UnreachableView, match="rig 'wrist'"):
                geometry.joints_for(view, near)


@EVERY_PRESET
@settings(max_examples=60)
@given(share=shares(), step=st.lists(st.floats(-0.05, 0.05), min_size=3, max_size=3))
def test_a_view_close_by_takes_a_small_step_of_the_joints(name: str, share: list[float], step: list[float]) -> None:
    geometry = rig(name)
    lower, upper = bounds(geometry)
    here = joints(geometry, share)
    there = np.clip(here + np.array(step[: len(here)]), lower, upper)
    found = np.array(geometry.joints_for(geometry.view_direction(there.tolist()), here.tolist()))
    assert np.abs(found - here).max() < 0.1


@EVERY_PRESET
@settings(max_examples=30)
@given(share=shares(), turns=st.integers(-3, 3))
def test_a_free_joint_keeps_its_whole_turns(name: str, share: list[float], turns: int) -> None:
    geometry = rig(name)
    view = geometry.view_direction(joints(geometry, share).tolist())
    free = np.array([math.isinf(limit.upper_rad) for limit in geometry.limits])
    near = np.where(free, turns * 2 * np.pi + 0.1, 0.0)
    found = np.array(geometry.joints_for(view, near.tolist()))
    assert_shows(geometry, tuple(found), view)
    assert (np.abs(found - near)[free] <= np.pi + 1e-6).all()


def test_the_nearer_of_two_ways_to_show_a_view_is_taken() -> None:
    geometry = rig("gimbal")
    view = geometry.view_direction((math.radians(95.0), 0.5))  # as well at a tilt of 85 deg, half a turn away
    over = geometry.joints_for(view, (math.radians(95.0), 0.5))
    before = geometry.joints_for(view, (math.radians(85.0), 0.5 + np.pi))
    assert np.degrees(over[0]) == pytest.approx(95.0, abs=0.1)
    assert np.degrees(before[0]) == pytest.approx(85.0, abs=0.1)


def test_limits_are_checked_with_no_more_than_a_roundings_grace() -> None:
    geometry = rig("pan_tilt")
    tilt = math.radians(60.0)
    positions = np.array([[tilt, 99.0], [tilt + 1e-10, 0.0], [tilt + 1e-6, 0.0], [-tilt - 1e-6, 0.0]])
    assert geometry.within_limits(positions).tolist() == [True, True, False, False]


def test_the_wrong_number_of_joint_angles_is_an_error() -> None:
    with pytest.raises(ValueError, match="zip"):
        rig("wrist").view_direction((0.0, 0.0))


@pytest.mark.parametrize("axis", [[0.0, 0.0, 0.0], [math.nan, 0.0, 1.0], [math.inf, 0.0, 0.0]])
def test_an_axis_without_direction_is_refused(axis: list[float]) -> None:
    with pytest.raises(BadConfig, match=r"rig 'mine', joint 'pan': axis .* has no direction; use e\.g\. \[0, 0, 1\]"):
        rig_geometry("mine", [axis], [LIMIT], 0.0)


@pytest.mark.parametrize(("lower", "upper"), [(1.0, -1.0), (1.0, 1.0), (math.nan, 1.0)])
def test_swapped_or_empty_limits_are_refused(lower: float, upper: float) -> None:
    with pytest.raises(BadConfig, match=r"rig 'mine', joint 'tilt': lower limit .* deg is not below the upper limit"):
        rig_geometry("mine", [[0, 1, 0]], [JointLimits("tilt", lower, upper, 1.0)], 0.0)


def test_axes_and_limits_must_come_in_pairs() -> None:
    with pytest.raises(BadConfig, match="rig 'mine' has 2 axes but 1 joint limits"):
        rig_geometry("mine", [[0, 1, 0], [0, 0, 1]], [LIMIT], 0.0)


def test_an_unknown_preset_is_refused_with_the_known_ones() -> None:
    with pytest.raises(BadConfig, match="unknown rig preset 'crane': choose one of turntable, pan_tilt, wrist, gimbal"):
        preset("crane")


def test_axes_may_have_any_length() -> None:
    long = rig_geometry("mine", [[0, 0, 20]], [LIMIT], 30.0)
    np.testing.assert_allclose(long.axes, [[0, 0, 1]])
    np.testing.assert_allclose(np.linalg.norm(long.view_direction((0.4,))), 1.0)


def test_home_is_the_nearest_whole_turn_of_free_joints_and_zero_of_others() -> None:
    geometry = preset("pan_tilt")
    assert geometry.home((0.5, 13.0)) == pytest.approx((0.0, 4 * np.pi))
    assert geometry.home((-0.5, -3.0)) == (0.0, 0.0)
    assert geometry.home() == (0.0, 0.0)
