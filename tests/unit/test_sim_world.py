"""The simulated rig moves as its geometry says, repeats itself exactly, and goes wrong only as it is asked to."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from viewsep.descriptors.cch import ColourCooccurrence
from viewsep.errors import Timeout
from viewsep.geometry import axis_rotation, quaternion_to_matrix, random_rotation, rotation_angle
from viewsep.interfaces import JointLimits
from viewsep.kinematics import PRESETS, RigGeometry, preset, rig_geometry
from viewsep.messages import Array, FloatArray, Frame
from viewsep.sim.camera import SimCamera
from viewsep.sim.clock import SimClock
from viewsep.sim.disturbances import Disturbances, disturbed
from viewsep.sim.motion import ENCODER_STEP_RAD, SimMotion
from viewsep.sim.physics import load_pybullet
from viewsep.sim.render import CameraOptics, MeshRenderer
from viewsep.sim.urdf import rig_urdf
from viewsep.sim.world import STEP_NS, SimWorld

pytestmark = pytest.mark.needs_pybullet

SECOND_NS = 1_000_000_000
NO_LIMITS = JointLimits("roll", -np.inf, np.inf, 1.0)
SLANTED = rig_geometry("slanted", [[1, 2, 3], [-1, 0, 1]], [NO_LIMITS, dataclasses.replace(NO_LIMITS, name="yaw")], 5.0)


@dataclass(frozen=True)
class SimRig:
    world: SimWorld
    motion: SimMotion
    camera: SimCamera
    clock: SimClock

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now_ns() + round(seconds * SECOND_NS))

    def look(self) -> Frame:
        return self.camera.read(self.clock.now_ns(), 2.0)


Open = Callable[..., SimRig]


@pytest.fixture
def open_rig(product_mesh: Path) -> Iterator[Open]:
    """Opens connected rigs: `open_rig(disturbances, name="gimbal", seed=0)`."""
    with ExitStack() as stack:

        def opened(disturbances: Disturbances | None = None, name: str = "gimbal", seed: int = 0) -> SimRig:
            clock = SimClock()
            world = SimWorld(preset(name), clock, seed, disturbances or Disturbances())
            motion = SimMotion(world, seed)
            camera = SimCamera(world, MeshRenderer(product_mesh, CameraOptics(64)), seed=seed)
            stack.callback(motion.close)
            stack.callback(camera.close)
            motion.connect()
            camera.connect()
            return SimRig(world, motion, camera, clock)

        yield opened


@pytest.mark.parametrize("geometry", [*map(preset, PRESETS), SLANTED], ids=lambda geometry: geometry.name)
def test_the_urdf_turns_the_object_as_the_geometry_says(geometry: RigGeometry, tmp_path: Path) -> None:
    bullet = load_pybullet()
    (tmp_path / "rig.urdf").write_text(rig_urdf(geometry), encoding="utf-8")
    client = bullet.connect(bullet.DIRECT)
    try:
        body = bullet.loadURDF(str(tmp_path / "rig.urdf"), useFixedBase=True, physicsClientId=client)
        joints = len(geometry.limits)
        assert bullet.getNumJoints(body, physicsClientId=client) == joints
        for seed in range(5):
            q = np.random.default_rng(seed).uniform(-1.0, 1.0, joints)
            for joint, angle in enumerate(q):
                bullet.resetJointState(body, joint, angle, physicsClientId=client)
            link = bullet.getLinkState(body, joints - 1, computeForwardKinematics=True, physicsClientId=client)
            np.testing.assert_allclose(
                quaternion_to_matrix(np.array(link[5])), geometry.holder_rotation(q.tolist()), atol=1e-6
            )
            np.testing.assert_allclose(link[4], 0.0, atol=1e-6)  # turns about the object's centre
    finally:
        bullet.disconnect(client)


def test_ten_seconds_of_motion_cost_little(open_rig: Open) -> None:
    rig = open_rig(name="wrist")
    start = time.process_time()
    for goal in (0.5, -0.5, 0.8, -0.8, 0.0):
        rig.motion.move_to([goal] * 3)
        for _ in range(100):
            rig.wait(0.02)
            rig.motion.read_state()
    assert rig.clock.now_ns() == 10 * SECOND_NS
    assert time.process_time() - start < 5.0


def course(rig: SimRig, steps_ns: Sequence[int]) -> list[object]:
    """What happens in two moves when time passes in the given steps, over and over."""
    position = 0
    for half, goal in enumerate(([0.6, -0.9], [-0.2, 0.4])):
        rig.motion.move_to(goal)
        end_ns = (half + 1) * SECOND_NS + 1_234_567
        while rig.clock.now_ns() < end_ns:
            rig.clock.sleep_until(min(end_ns, rig.clock.now_ns() + steps_ns[position % len(steps_ns)]))
            position += 1
    return list(rig.world.moments)


def test_the_course_of_events_does_not_depend_on_how_the_clock_is_advanced(open_rig: Open) -> None:
    disturbances = Disturbances(backlash_deg=1.0)
    at_once = course(open_rig(disturbances), [10 * SECOND_NS])
    assert len(at_once) == 501
    assert course(open_rig(disturbances), [7_654_321, 1, STEP_NS, 333]) == at_once
    assert course(open_rig(disturbances), [STEP_NS]) == at_once


def test_steps_lie_on_one_grid_of_time(open_rig: Open) -> None:
    rig = open_rig()
    for _ in range(20):
        rig.wait(0.0131)
    stamps = [moment.stamp_ns for moment in rig.world.moments]
    assert stamps == list(range(0, stamps[-1] + 1, STEP_NS))


def test_the_load_is_interpolated_between_the_moments_around(open_rig: Open) -> None:
    rig = open_rig(Disturbances(backlash_deg=1.0))
    rig.motion.move_to([1.0, -0.5])
    rig.wait(2.0)
    stamps = [moment.stamp_ns for moment in rig.world.moments]
    loads = np.array([moment.load_rad for moment in rig.world.moments])
    for stamp in [-5, 0, 1, STEP_NS, SECOND_NS + 1_234_567, stamps[-1] - 1, stamps[-1], stamps[-1] + SECOND_NS]:
        expected = [np.interp(stamp, stamps, joint) for joint in loads.T]
        np.testing.assert_array_equal(rig.world.load_at(stamp), expected)


def test_time_never_goes_back() -> None:
    clock = SimClock(50)
    clock.sleep_until(20)
    assert clock.now_ns() == 50


@pytest.mark.parametrize("name", PRESETS)
def test_joints_start_at_zero_and_the_picture_shows_the_grasp_from_there(open_rig: Open, name: str) -> None:
    rig = open_rig(name=name)
    np.testing.assert_array_equal(rig.world.load_at(0), 0.0)
    np.testing.assert_allclose(rig.world.object_rotation(0), rig.world.grasp, atol=1e-12)


def test_a_joint_that_cannot_be_at_zero_starts_at_the_nearest_limit() -> None:
    limits = JointLimits("pan", 0.5, 1.5, 1.0)
    world = SimWorld(rig_geometry("far", [[0, 0, 1]], [limits], 0.0), SimClock(), 0, Disturbances())
    world.open()
    np.testing.assert_array_equal(world.load_at(0), [0.5])
    world.close()


def test_the_grasp_comes_from_the_seed_or_from_the_caller() -> None:
    def grasp(seed: int, given: FloatArray | None = None) -> FloatArray:
        return SimWorld(preset("gimbal"), SimClock(), seed, Disturbances(), given).grasp

    np.testing.assert_array_equal(grasp(4), grasp(4))
    assert float(rotation_angle(grasp(4), grasp(5))) > 0.1
    np.testing.assert_array_equal(grasp(4, np.eye(3)), np.eye(3))


def test_the_load_lags_half_the_play_behind_the_motor_each_way(open_rig: Open) -> None:
    rig = open_rig(Disturbances(backlash_deg=4.0))
    lag_deg = []
    for goal in (0.5, -0.3):
        rig.motion.move_to([0.0, goal])
        rig.wait(5.0)
        newest = rig.world.moments[-1]
        lag_deg.append(np.degrees(newest.motor_rad[1] - newest.load_rad[1]))
        assert rig.motion.read_state().position_rad[1] == pytest.approx(newest.motor_rad[1], abs=ENCODER_STEP_RAD)
    assert lag_deg == pytest.approx([2.0, -2.0], abs=1e-3)


def test_the_load_rests_while_the_motor_takes_up_the_play(open_rig: Open) -> None:
    rig = open_rig(Disturbances(backlash_deg=4.0))
    rig.motion.move_to([0.0, 0.5])
    rig.wait(4.0)
    load, motor = rig.world.moments[-1].load_rad[1], rig.world.moments[-1].motor_rad[1]
    rig.motion.move_to([0.0, 0.5 - np.radians(3.0)])
    rig.wait(1.0)
    assert rig.world.moments[-1].motor_rad[1] < motor - np.radians(2.5)
    assert rig.world.moments[-1].load_rad[1] == pytest.approx(load, abs=1e-6)


def test_without_backlash_the_load_is_the_motor(open_rig: Open) -> None:
    rig = open_rig()
    rig.motion.move_to([0.5, 0.5])
    rig.wait(1.0)
    assert all(moment.load_rad == moment.motor_rad for moment in rig.world.moments)


def test_the_encoder_has_steps_and_its_noise_the_deviation_asked_for(open_rig: Open) -> None:
    rig = open_rig(Disturbances(encoder_noise_deg=0.5))
    rig.wait(15.0)
    angles = np.array([state.position_rad for state in rig.motion.history(0)])
    np.testing.assert_allclose(angles / ENCODER_STEP_RAD, np.round(angles / ENCODER_STEP_RAD), atol=1e-6)
    assert len(angles) > 900
    np.testing.assert_allclose(np.degrees(angles.std(axis=0)), 0.5, rtol=0.1)
    np.testing.assert_allclose(np.degrees(angles.mean(axis=0)), 0.0, atol=0.07)
    assert abs(np.corrcoef(angles.T)[0, 1]) < 0.15
    assert all(not state.moving for state in rig.motion.history(0))


def test_the_encoder_without_noise_is_off_by_at_most_half_a_step(open_rig: Open) -> None:
    rig = open_rig()
    rig.motion.move_to([0.3, 0.4])
    rig.wait(1.0)
    truth = {moment.stamp_ns: moment.motor_rad for moment in rig.world.moments}
    for state in rig.motion.history(0):
        np.testing.assert_allclose(state.position_rad, truth[state.stamp_ns], atol=0.5001 * ENCODER_STEP_RAD)


def test_encoder_noise_follows_the_seed(open_rig: Open) -> None:
    def angles(seed: int) -> list[tuple[float, ...]]:
        rig = open_rig(Disturbances(encoder_noise_deg=0.5), seed=seed)
        rig.wait(0.5)
        return [state.position_rad for state in rig.motion.history(0)]

    assert angles(1) == angles(1)
    assert angles(1) != angles(2)


def test_the_object_slips_once_at_the_moment_asked_for(open_rig: Open) -> None:
    rig, steady = open_rig(Disturbances(slip_deg=20.0, slip_after_s=2.0)), open_rig()
    moments_ns = (0, SECOND_NS, 2 * SECOND_NS - 1, 2 * SECOND_NS, 9 * SECOND_NS)
    slipped_deg = [np.degrees(float(rotation_angle(rig.world.grasp_at(at), rig.world.grasp))) for at in moments_ns]
    assert slipped_deg == pytest.approx([0.0, 0.0, 0.0, 20.0, 20.0], abs=1e-6)
    np.testing.assert_array_equal(rig.look().image, steady.look().image)
    for each in (rig, steady):
        each.wait(2.0)
    assert (rig.look().image != steady.look().image).any()
    np.testing.assert_array_equal(steady.world.grasp_at(9 * SECOND_NS), steady.world.grasp)


def test_a_late_frame_is_stamped_with_its_exposure(open_rig: Open) -> None:
    prompt, late = open_rig(), open_rig(Disturbances(latency_s=0.25))
    for rig in (prompt, late):
        rig.motion.move_to([0.0, 1.5])
        rig.wait(0.4)
    frames = [prompt.look(), late.look()]
    assert frames[0].stamp_ns == frames[1].stamp_ns
    assert 0 <= prompt.clock.now_ns() - frames[0].stamp_ns < STEP_NS
    assert late.clock.now_ns() == frames[1].stamp_ns + SECOND_NS // 4
    np.testing.assert_array_equal(frames[0].image, frames[1].image)  # what was there then, not what is there now


def test_a_frame_that_would_come_too_late_is_a_timeout(open_rig: Open) -> None:
    rig = open_rig(Disturbances(latency_s=0.5))
    with pytest.raises(Timeout, match=r"no frame within 0\.3 s"):
        rig.camera.read(0, 0.3)
    assert rig.clock.now_ns() == round(0.3 * SECOND_NS)


def test_a_camera_that_loses_everything_times_out(open_rig: Open) -> None:
    rig = open_rig(Disturbances(drop_rate=1.0))
    with pytest.raises(Timeout, match=r"no frame within 0\.5 s"):
        rig.camera.read(0, 0.5)


def test_the_moment_of_exposure_is_on_the_cameras_grid(open_rig: Open) -> None:
    rig = open_rig()
    frame = rig.camera.read(100_000_000, 1.0)
    assert frame.sequence == 4  # 30 Hz: 0.1 s is just past the third exposure
    assert frame.stamp_ns == frame.sequence * round(SECOND_NS / 30)


def arrivals(rig: SimRig, pause_s: float, until: int) -> list[tuple[int, int]]:
    """(sequence, drops counted so far) of the frames read with pauses."""
    seen: list[tuple[int, int]] = []
    newest_ns = 0
    while not seen or seen[-1][0] < until:
        frame = rig.camera.read(newest_ns, 2.0)
        seen.append((frame.sequence, rig.camera.drops))
        rig.wait(pause_s)
        newest_ns = max(frame.stamp_ns, rig.clock.now_ns() - 1)
    return seen


def test_which_frames_are_lost_follows_the_seed_and_not_who_reads(open_rig: Open) -> None:
    lossy = Disturbances(drop_rate=0.3)
    every = arrivals(open_rig(lossy), 0.0, 200)
    arrived, drops = dict(every), [lost for _, lost in every]
    assert 0.2 < drops[-1] / every[-1][0] < 0.4
    assert every[-1][0] == len(every) + drops[-1]
    assert arrivals(open_rig(lossy), 0.0, 200) == every
    assert arrivals(open_rig(lossy, seed=1), 0.0, 200) != every
    now_and_then = arrivals(open_rig(lossy), 0.21, 200)
    assert 20 < len(now_and_then) < 40
    for sequence, lost in now_and_then[:-1]:
        assert arrived[sequence] == lost


PICTURES_GO_WRONG = {
    "light": Disturbances(light=0.3),
    "light_offset": Disturbances(light_offset=0.3),
    "white_balance": Disturbances(white_balance=0.2),
    "noise": Disturbances(noise=0.05),
    "blur": Disturbances(blur_px=2.0),
    "mask_error": Disturbances(mask_error=0.1),
}


def test_every_disturbance_is_off_by_default_and_leaves_pictures_alone(open_rig: Open) -> None:
    off = Disturbances()
    strengths = dataclasses.asdict(off)
    del strengths["slip_after_s"]
    assert set(strengths.values()) == {0.0}
    rig = open_rig(off)
    rig.motion.move_to([0.3, 0.4])
    frame = rig.look()
    image, mask = rig.camera._pictures.render(
        rig.world.geometry.camera_direction, rig.world.object_rotation(frame.stamp_ns)
    )
    np.testing.assert_array_equal(frame.image, image)
    np.testing.assert_array_equal(frame.mask, mask)
    same_image, same_mask = disturbed(image, mask, off, np.random.default_rng(0))
    assert same_image is image
    assert same_mask is mask


@pytest.mark.parametrize("what", PICTURES_GO_WRONG)
def test_a_disturbance_changes_pictures_and_follows_the_seed(open_rig: Open, what: str) -> None:
    def looks(disturbances: Disturbances, seed: int) -> list[tuple[bytes, bytes]]:
        rig = open_rig(disturbances, seed=seed)
        rig.world.grip.rotation = np.eye(3)  # only the disturbances follow the seed
        frames = [rig.look() for _ in range(2)]
        assert all(frame.mask is not None and frame.mask.any() for frame in frames)
        return [(frame.image.tobytes(), b"" if frame.mask is None else frame.mask.tobytes()) for frame in frames]

    clean, spoilt = looks(Disturbances(), 1), looks(PICTURES_GO_WRONG[what], 1)
    part = 1 if what == "mask_error" else 0
    for before, after in zip(clean, spoilt, strict=True):
        assert before[part] != after[part]
        assert before[1 - part] == after[1 - part]
    assert looks(PICTURES_GO_WRONG[what], 1) == spoilt
    if what != "blur":  # takes nothing from chance
        assert looks(PICTURES_GO_WRONG[what], 2) != spoilt
        same_for_all = what in ("light_offset", "white_balance")
        assert same_for_all or spoilt[0] != spoilt[1]


def grey(disturbances: Disturbances, seed: int = 0) -> tuple[Array, Array]:
    """A disturbed grey picture with a round object."""
    y, x = np.mgrid[:96, :96]
    mask = (y - 48) ** 2 + (x - 48) ** 2 < 30**2
    return disturbed(np.full((96, 96, 3), 120, np.uint8), mask, disturbances, np.random.default_rng(seed))


def test_light_scales_the_whole_picture_within_its_range() -> None:
    levels = []
    for seed in range(200):
        image, _ = grey(Disturbances(light=0.3), seed)
        assert np.ptp(image) == 0
        levels.append(float(image[0, 0, 0]) / 120)
    assert 0.69 < min(levels) < 0.75
    assert 1.25 < max(levels) < 1.301


def test_noise_has_the_deviation_asked_for() -> None:
    image, _ = grey(Disturbances(noise=0.05))
    assert image.std() == pytest.approx(0.05 * 255, rel=0.03)
    assert image.mean() == pytest.approx(120, abs=1.0)


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_the_mask_is_wrong_by_about_the_share_asked_for_and_only_near_its_outline(share: float) -> None:
    _, right = grey(Disturbances())
    y, x = np.mgrid[:96, :96]
    far = np.abs(np.hypot(y - 48, x - 48) - 30) > 8
    wrong = []
    for seed in range(20):
        _, mask = grey(Disturbances(mask_error=share), seed)
        assert not (mask ^ right)[far].any()
        wrong.append((mask ^ right).sum() / right.sum())
    assert 0.4 * share < np.mean(wrong) < 1.6 * share


@pytest.fixture
def open_renderer(product_mesh: Path) -> Iterator[Callable[[], MeshRenderer]]:
    with ExitStack() as stack:

        def opened() -> MeshRenderer:
            renderer = MeshRenderer(product_mesh, CameraOptics(96))
            stack.callback(renderer.close)
            return renderer

        yield opened


def test_a_picture_does_not_depend_on_what_was_rendered_before(open_renderer: Callable[[], MeshRenderer]) -> None:
    rotations = [random_rotation(np.random.default_rng(seed)) for seed in range(6)]
    camera = np.array([1.0, 0.0, 0.0])
    fresh = [open_renderer().render(camera, rotation) for rotation in rotations]
    used = open_renderer()
    for order in ([3, 0, 5, 1, 4, 2], [2, 2, 4, 3, 1, 0, 5]):
        for index in order:
            image, mask = used.render(camera, rotations[index])
            assert image.tobytes() == fresh[index][0].tobytes()
            assert mask.tobytes() == fresh[index][1].tobytes()


def test_two_worlds_at_a_time_do_not_disturb_each_other(open_rig: Open) -> None:
    def ride(rig: SimRig) -> Iterator[bytes]:
        rig.motion.move_to([0.4, 1.0])
        for _ in range(5):
            rig.wait(0.1)
            yield rig.look().image.tobytes()

    alone = list(ride(open_rig()))
    both = list(zip(ride(open_rig()), ride(open_rig(seed=3)), strict=True))
    assert [first for first, _ in both] == alone
    assert len(set(alone)) == 5


@pytest.mark.parametrize("camera_elevation_deg", [0.0, 25.0, 90.0])
def test_rolling_the_object_about_the_line_of_sight_hardly_changes_the_feature(
    open_renderer: Callable[[], MeshRenderer], camera_elevation_deg: float
) -> None:
    renderer, descriptor = open_renderer(), ColourCooccurrence()
    elevation = np.radians(camera_elevation_deg)
    camera = np.array([np.cos(elevation), 0.0, np.sin(elevation)])
    for seed in range(5):
        rng = np.random.default_rng(seed)
        rotation = random_rotation(rng)
        rolled = axis_rotation(camera, rng.uniform(0.3, 6.0)) @ rotation
        feature = descriptor.describe(*renderer.render(camera, rotation))
        others = [descriptor.describe(*renderer.render(camera, other)) for other in (rolled, random_rotation(rng))]
        same, different = descriptor.similarity(feature, np.array(others))
        assert same > 0.9
        assert different < same
