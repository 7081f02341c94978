"""A percept pairs a frame with where the joints were when it was exposed, not with where they are by now."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.descriptors.cch import ColourCooccurrence
from viewsep.errors import BadInput, Timeout
from viewsep.geometry import angle_between
from viewsep.kinematics import preset
from viewsep.messages import Frame, JointState
from viewsep.perception import perceive, position_at
from viewsep.sim.camera import SimCamera
from viewsep.sim.clock import SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.motion import SimMotion
from viewsep.sim.render import CameraOptics, MeshRenderer
from viewsep.sim.world import SimWorld

BOOT_NS = 1_700_000_000_123_456_789  # too large for a float to hold to the nanosecond
IMAGE = np.random.default_rng(0).integers(0, 256, (32, 32, 3), np.uint8)
MASK = np.ones((32, 32), np.bool_)


def reading(stamp_ns: int, *position_rad: float) -> JointState:
    return JointState(stamp_ns, position_rad, tuple(9.0 for _ in position_rad), True)


@given(
    st.integers(0, BOOT_NS),
    st.integers(1, 10**10),
    st.floats(0.0, 1.0),
    st.lists(st.tuples(st.floats(-7.0, 7.0), st.floats(-7.0, 7.0)), min_size=1, max_size=3),
)
def test_joint_angles_are_interpolated_in_a_straight_line(
    start_ns: int, gap_ns: int, share: float, ends: list[tuple[float, float]]
) -> None:
    before, after = zip(*ends, strict=True)
    history = [reading(start_ns, *before), reading(start_ns + gap_ns, *after)]
    inside_ns = round(share * gap_ns)
    expected = [a + (b - a) * inside_ns / gap_ns for a, b in ends]
    np.testing.assert_allclose(position_at(start_ns + inside_ns, history), expected, atol=1e-9)


@given(st.lists(st.integers(1, 10**9), min_size=1, max_size=8), st.data())
def test_only_the_two_readings_around_the_moment_count(gaps_ns: list[int], data: st.DataObject) -> None:
    stamps = [BOOT_NS + int(offset) for offset in np.cumsum([0, *gaps_ns])]
    history = [reading(stamp, float(number**2), -float(number)) for number, stamp in enumerate(stamps)]
    stamp_ns = data.draw(st.integers(stamps[0], stamps[-1]))
    after = next(number for number, stamp in enumerate(stamps) if stamp >= stamp_ns)
    around = history[max(0, after - 1) : after + 1]
    np.testing.assert_allclose(position_at(stamp_ns, history), position_at(stamp_ns, around), atol=1e-9)
    if stamp_ns in stamps:
        np.testing.assert_array_equal(position_at(stamp_ns, history), history[after].position_rad)


def test_a_nanosecond_matters_long_after_boot() -> None:
    history = [reading(BOOT_NS, 0.0), reading(BOOT_NS + 4, 1.0)]
    assert [float(position_at(BOOT_NS + k, history)[0]) for k in range(5)] == [0.0, 0.25, 0.5, 0.75, 1.0]


@pytest.mark.parametrize("offset_ns", [-1, 101])
def test_a_moment_outside_the_readings_is_not_extrapolated(offset_ns: int) -> None:
    with pytest.raises(Timeout, match="no joint read-backs around the frame's time stamp"):
        position_at(BOOT_NS + offset_ns, [reading(BOOT_NS, 0.0), reading(BOOT_NS + 100, 1.0)])


def test_without_readings_there_is_no_position() -> None:
    with pytest.raises(Timeout, match="no joint read-backs"):
        position_at(0, [])


def test_the_view_is_the_one_at_the_frames_stamp() -> None:
    geometry, descriptor = preset("pan_tilt"), ColourCooccurrence()
    history = [reading(0, 0.0, 0.0), reading(100, 0.2, 1.0), reading(200, 0.4, 3.0)]
    percept = perceive(Frame(50, 7, IMAGE, MASK), history, geometry, descriptor)
    np.testing.assert_allclose(percept.view_direction, geometry.view_direction((0.1, 0.5)), atol=1e-12)
    assert (percept.stamp_ns, percept.sequence, percept.descriptor) == (50, 7, "cch")
    np.testing.assert_array_equal(percept.feature, descriptor.describe(IMAGE, MASK))


def test_a_frame_that_shows_no_object_is_bad_input() -> None:
    frame = Frame(50, 7, IMAGE, np.zeros_like(MASK))
    with pytest.raises(BadInput, match="covers too little of the picture"):
        perceive(frame, [reading(0, 0.0), reading(100, 0.1)], preset("turntable"), ColourCooccurrence())


@pytest.mark.needs_pybullet
def test_a_late_frame_of_a_turning_object_gets_the_view_it_was_exposed_at(product_mesh: Path) -> None:
    geometry, clock = preset("turntable"), SimClock()
    world = SimWorld(geometry, clock, 0, Disturbances(latency_s=0.3))
    motion, camera = SimMotion(world), SimCamera(world, MeshRenderer(product_mesh, CameraOptics(64)))
    motion.connect()
    camera.connect()
    motion.move_to([2.0])
    clock.sleep_until(500_000_000)
    frame = camera.read(clock.now_ns(), 1.0)
    percept = perceive(frame, motion.history(frame.stamp_ns), geometry, ColourCooccurrence())
    truth = geometry.view_direction(world.load_at(frame.stamp_ns).tolist())
    newest = geometry.view_direction(motion.read_state().position_rad)
    camera.close()
    motion.close()
    assert np.degrees(float(angle_between(percept.view_direction, truth))) < 0.1
    assert np.degrees(float(angle_between(percept.view_direction, newest))) > 2.0
