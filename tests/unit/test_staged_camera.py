"""The staged camera: as imperfect as it is told to be, and the same again for the same seed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from viewsep.geometry import axis_rotation
from viewsep.kinematics import preset
from viewsep.messages import Array, FloatArray
from viewsep.sim.clock import SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.followed import FollowedJoints
from viewsep.sim.stage import Stage, Staging
from viewsep.sim.staged_camera import EMPTY, Delivery, StagedCamera

SMALL = Staging(size=(96, 72), object_px=40, plate=True, gripper=True, seed=4)
SECOND_NS = 1_000_000_000


class Ball:
    """`Pictures` of a red disc."""

    def render(self, camera_direction: FloatArray, rotation: FloatArray) -> tuple[Array, Array]:
        y, x = np.mgrid[:40, :40] - 19.5
        mask = np.hypot(x, y) < 18
        return np.where(mask[..., None], np.array([200, 30, 30], np.uint8), np.uint8(255)), mask

    def close(self) -> None:
        pass


def camera(staging: Staging = SMALL, delivery: Delivery | None = None, *, empty: bool = False) -> StagedCamera:
    def joints_at(stamp_ns: int) -> tuple[float, ...]:
        return (stamp_ns * 1e-9,)

    scene = FollowedJoints(preset("turntable"), SimClock(), 0, Disturbances(), joints_at)
    made = StagedCamera(scene, None if empty else Ball(), Stage(staging), joints_at, delivery)
    made.connect()
    return made


def clock_of(made: StagedCamera) -> SimClock:
    return made._scene.clock


def test_the_same_exposure_looks_the_same_whatever_was_read_before() -> None:
    a, b = camera(), camera()
    for _ in range(3):
        a.read(clock_of(a).now_ns(), 1.0)
    late, only = (made.read(SECOND_NS, 2.0) for made in (a, b))
    assert late.stamp_ns == only.stamp_ns
    np.testing.assert_array_equal(late.image, only.image)
    np.testing.assert_array_equal(a.true_mask(late.stamp_ns), b.true_mask(only.stamp_ns))
    other = camera(replace(SMALL, seed=5)).read(SECOND_NS, 2.0)
    assert (other.image != only.image).any()


def test_frames_have_no_mask_but_the_truth_can_be_asked() -> None:
    made = camera()
    frame = made.read(0, 1.0)
    assert frame.mask is None
    truth = made.true_mask(frame.stamp_ns)
    assert truth.shape == (72, 96)
    assert 400 < truth.sum() < 1100  # a disc of 18 pixels radius behind a gripper
    assert frame.image[truth][:, 0].mean() > frame.image[truth][:, 1].mean() + 80
    with pytest.raises(KeyError):
        made.true_mask(frame.stamp_ns + 1)


def test_the_empty_rig_shows_no_object() -> None:
    made = camera(empty=True)
    assert not made.true_mask(made.read(0, 1.0).stamp_ns).any()


@pytest.mark.parametrize("discards", [True, False])
def test_after_a_pause_the_queue_holds_old_frames_that_a_good_driver_discards(discards: bool) -> None:
    made = camera(delivery=Delivery(latency_s=0.0, buffers=3, discards=discards))
    clock = clock_of(made)
    before = made.read(clock.now_ns(), 1.0)
    clock.sleep_until(2 * SECOND_NS)
    asked_ns = clock.now_ns()
    frames = [made.read(asked_ns, 1.0) for _ in range(4)]
    old = [frame.stamp_ns <= asked_ns for frame in frames]
    assert old == ([False] * 4 if discards else [True, True, True, False])
    if not discards:
        assert [frame.sequence - before.sequence for frame in frames[:3]] == [1, 2, 3]


def test_exposure_wanders_within_what_was_said() -> None:
    stage = Stage(replace(SMALL, exposure_drift=0.2, exposure_offset=0.0, colour_drift=0.0, drift_period_s=10.0))
    exposures = np.array([stage.exposure(seconds) for seconds in np.linspace(0.0, 10.0, 101)])
    assert exposures.min() == pytest.approx(0.8, abs=0.01)
    assert exposures.max() == pytest.approx(1.2, abs=0.01)
    assert np.abs(np.diff(exposures, axis=0)).max() < 0.02  # it drifts, it does not jump


def test_the_object_goes_moves_and_the_lamps_are_switched_when_told() -> None:
    picture, mask = Ball().render(np.zeros(3), np.eye(3))
    calm = replace(SMALL, plate=False, gripper=False, shake_px=0.0, noise=0.0, exposure_drift=0.0, colour_drift=0.0)
    stage = Stage(replace(calm, moved_s=1.0, moved_px=(10, -5), removed_s=2.0))
    there, moved, gone = (stage.exposed(picture, mask, [0.0], s * SECOND_NS, s)[1] for s in (0, 1, 2))
    np.testing.assert_array_equal(np.roll(there, (-5, 10), (0, 1)), moved)
    assert not gone.any()
    switched = Stage(replace(calm, switched_s=1.0, switched_to=0.5))
    on, off = (switched.exposed(*EMPTY, [0.0], s * SECOND_NS, s)[0].mean() for s in (0, 1))
    assert off == pytest.approx(0.5 * on, rel=0.1)


def test_the_print_turns_with_the_joint_and_the_shadow_is_darker() -> None:
    calm = replace(SMALL, gripper=False, shake_px=0.0, noise=0.0, exposure_drift=0.0, colour_drift=0.0)
    stage = Stage(calm)
    pictures = [stage.exposed(*EMPTY, [angle], 0, 0)[0] for angle in (0.0, 1.0, 2.0 * np.pi)]
    np.testing.assert_allclose(pictures[0].astype(int), pictures[2].astype(int), atol=1)
    assert np.abs(pictures[0].astype(int) - pictures[1]).max() > 50
    picture, mask = Ball().render(np.zeros(3), axis_rotation(np.array([0.0, 0.0, 1.0]), 0.0))
    image, truth = stage.exposed(picture, mask, [0.0], 0, 0)
    beside = np.roll(truth, (4, 6), (0, 1)) & ~np.asarray(np.roll(truth, (1, 1), (0, 1)) | truth)
    assert image[beside].mean() < 0.95 * pictures[0][beside].mean()
