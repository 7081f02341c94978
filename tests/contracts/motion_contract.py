"""What every motion backend keeps, whatever drives the joints. `test_motion.py` lists the implementations."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pytest

from viewsep.errors import MoveRefused, NotConnected
from viewsep.interfaces import Clock, MotionBackend
from viewsep.messages import JointState

SECOND_NS = 1_000_000_000
POLL_NS = 20_000_000


@dataclass(frozen=True)
class MotionCase:
    """A backend that was constructed and nothing else.

    `step_rad` is what its set-points are rounded to, `accuracy_rad` how close to them the joints come to rest,
    `stamp_accuracy_s` how far a read-back's time may be off, because a busy machine came late to the device.
    """

    motion: MotionBackend
    clock: Clock
    step_rad: float
    accuracy_rad: float = math.radians(0.3)
    stamp_accuracy_s: float = 0.0


class MotionContract:
    """Subclass as `Test…` with a fixture `case` that gives a MotionCase of each implementation."""

    def test_limits_are_known_before_connecting(self, case: MotionCase) -> None:
        limits = case.motion.limits()
        assert len(limits) >= 1
        assert len({limit.name for limit in limits}) == len(limits)
        assert all(limit.lower_rad < limit.upper_rad for limit in limits)
        assert all(0.0 < limit.max_speed_rad_s < math.inf for limit in limits)
        with connected(case):
            assert case.motion.limits() == limits

    def test_nothing_works_before_connecting(self, case: MotionCase) -> None:
        self.assert_not_connected(case)

    def test_nothing_works_after_closing_and_closing_twice_is_safe(self, case: MotionCase) -> None:
        with connected(case):
            pass
        case.motion.close()
        self.assert_not_connected(case)

    def test_closing_what_was_never_connected_is_safe(self, case: MotionCase) -> None:
        case.motion.close()
        case.motion.close()

    def test_it_stands_still_within_its_limits_when_connected(self, case: MotionCase) -> None:
        with connected(case):
            state = case.motion.read_state()
            later = after(case, 0.5)
            assert not later.moving
            assert later.stamp_ns > state.stamp_ns
            np.testing.assert_allclose(later.position_rad, state.position_rad, atol=2 * case.step_rad)
            for angle, limit in zip(state.position_rad, case.motion.limits(), strict=True):
                assert limit.lower_rad - case.accuracy_rad <= angle <= limit.upper_rad + case.accuracy_rad

    def test_there_is_no_fault(self, case: MotionCase) -> None:
        with connected(case):
            assert case.motion.fault() == ""
            assert case.motion.read_state().fault == ""

    def test_clearing_without_a_fault_disturbs_nothing(self, case: MotionCase) -> None:
        with connected(case):
            commanded = case.motion.move_to(within(case, 0.6))
            case.motion.clear_fault()
            _, state = settled(case)
            np.testing.assert_allclose(state.position_rad, commanded, atol=case.accuracy_rad)

    def test_every_joint_has_a_temperature_or_none(self, case: MotionCase) -> None:
        with connected(case):
            temperatures = case.motion.temperatures_c()
        assert len(temperatures) == len(case.motion.limits())
        assert all(value is None or -40.0 < value < 150.0 for value in temperatures)

    def test_counters_only_grow(self, case: MotionCase) -> None:
        with connected(case):
            before = case.motion.counters()
            case.motion.move_to(within(case, 0.6))
            after(case, 0.2)
            counted = case.motion.counters()
        assert counted.keys() == before.keys()
        assert all(counted[name] >= count for name, count in before.items())

    def test_it_commands_what_it_says_and_arrives_there(self, case: MotionCase) -> None:
        with connected(case):
            for share in (0.8, 0.3):
                goal = within(case, share)
                commanded = case.motion.move_to(goal)
                np.testing.assert_allclose(commanded, goal, atol=case.step_rad)
                was_moving, state = settled(case)
                assert was_moving
                assert state.setpoint_rad == pytest.approx(commanded, abs=1e-9)
                np.testing.assert_allclose(state.position_rad, commanded, atol=case.accuracy_rad)

    def test_what_is_commanded_at_a_limit_lies_within_it(self, case: MotionCase) -> None:
        with connected(case):
            for share in (0.0, 1.0):
                commanded = case.motion.move_to(within(case, share))
                np.testing.assert_allclose(commanded, within(case, share), atol=case.step_rad)
                for angle, limit in zip(commanded, case.motion.limits(), strict=True):
                    assert limit.lower_rad <= angle <= limit.upper_rad

    def test_a_set_point_replaces_the_one_before(self, case: MotionCase) -> None:
        with connected(case):
            case.motion.move_to(within(case, 0.9))
            after(case, 0.2)
            commanded = case.motion.move_to(within(case, 0.4))
            _, state = settled(case)
            np.testing.assert_allclose(state.position_rad, commanded, atol=case.accuracy_rad)

    def test_it_keeps_to_the_speed_limit(self, case: MotionCase) -> None:
        with connected(case):
            since_ns = case.clock.now_ns()
            case.motion.move_to(within(case, 0.9))
            settled(case)
            history = spaced(case.motion.history(since_ns), 25 * case.stamp_accuracy_s)
            seconds = np.diff([state.stamp_ns for state in history]) / SECOND_NS
            speed = np.abs(np.diff([state.position_rad for state in history], axis=0)) / seconds[:, None]
            fastest = np.array([limit.max_speed_rad_s for limit in case.motion.limits()])
            rounding = case.step_rad / seconds.min()
            late = 2 * case.stamp_accuracy_s / seconds.min()
            assert (speed.max(axis=0) <= (1.05 + late) * fastest + rounding).all()

    @pytest.mark.parametrize("beyond_rad", [0.01, 1.0, math.inf, math.nan])
    def test_a_set_point_outside_the_limits_is_refused_and_nothing_moves(
        self, case: MotionCase, beyond_rad: float
    ) -> None:
        limits = case.motion.limits()
        with connected(case):
            for joint, limit in enumerate(limits):
                for edge, sign in ((limit.lower_rad, -1.0), (limit.upper_rad, 1.0)):
                    if math.isfinite(edge) or not math.isfinite(beyond_rad):  # a free joint takes every finite angle
                        goal = list(within(case, 0.8))
                        goal[joint] = (edge if math.isfinite(edge) else 0.0) + sign * beyond_rad
                        self.assert_refused(case, goal, limit.name)

    def test_the_wrong_number_of_set_points_is_refused_and_nothing_moves(self, case: MotionCase) -> None:
        with connected(case):
            goal = within(case, 0.8)
            for wrong in (goal[:-1], (*goal, 0.0)):
                self.assert_refused(case, wrong, "joints")

    def test_a_refused_move_does_not_disturb_the_one_under_way(self, case: MotionCase) -> None:
        with connected(case):
            commanded = case.motion.move_to(within(case, 0.8))
            after(case, 0.1)
            with pytest.raises(MoveRefused):
                case.motion.move_to([])
            _, state = settled(case)
            np.testing.assert_allclose(state.position_rad, commanded, atol=case.accuracy_rad)

    def test_the_history_is_in_order_and_covers_what_was_asked_for(self, case: MotionCase) -> None:
        with connected(case):
            after(case, 1.0)
            since_ns = case.clock.now_ns() - SECOND_NS // 2
            case.motion.move_to(within(case, 0.8))
            newest = after(case, 0.5)
            history = case.motion.history(since_ns)
            stamps = [state.stamp_ns for state in history]
            assert stamps == sorted(set(stamps))
            assert stamps[0] <= since_ns < stamps[1]
            assert stamps[-1] >= newest.stamp_ns
            assert max(np.diff(stamps)) < 0.2 * SECOND_NS
            assert history[-1].position_rad != history[0].position_rad

    def test_a_history_asked_for_twice_says_the_same_about_the_past(self, case: MotionCase) -> None:
        with connected(case):
            case.motion.move_to(within(case, 0.8))
            since_ns = case.clock.now_ns()
            after(case, 0.3)
            before = case.motion.history(since_ns)
            after(case, 0.3)
            assert case.motion.history(since_ns)[: len(before)] == before

    def test_the_history_of_now_holds_the_newest_reading(self, case: MotionCase) -> None:
        with connected(case):
            after(case, 0.5)
            history = case.motion.history(case.clock.now_ns())
            assert history[-1].stamp_ns <= case.clock.now_ns()
            assert case.clock.now_ns() - history[-1].stamp_ns < 0.2 * SECOND_NS

    def test_stop_holds_where_the_joints_are(self, case: MotionCase) -> None:
        with connected(case):
            start = case.motion.read_state().position_rad
            goal = case.motion.move_to(within(case, 0.9))
            stopped_at = after(case, 0.25).position_rad
            case.motion.stop()
            after(case, 1.0)
            _, state = settled(case)
            assert np.abs(np.subtract(state.position_rad, start)).max() > math.radians(1.0)
            assert np.abs(np.subtract(state.position_rad, goal)).max() > math.radians(5.0)
            np.testing.assert_allclose(state.position_rad, stopped_at, atol=math.radians(5.0))
            np.testing.assert_allclose(state.setpoint_rad, state.position_rad, atol=math.radians(1.0))
            np.testing.assert_allclose(after(case, 1.0).position_rad, state.position_rad, atol=case.accuracy_rad)

    def test_it_moves_again_after_a_stop(self, case: MotionCase) -> None:
        with connected(case):
            case.motion.stop()
            commanded = case.motion.move_to(within(case, 0.7))
            _, state = settled(case)
            np.testing.assert_allclose(state.position_rad, commanded, atol=case.accuracy_rad)

    def assert_not_connected(self, case: MotionCase) -> None:
        with pytest.raises(NotConnected, match=r"connect"):
            case.motion.read_state()
        with pytest.raises(NotConnected, match=r"connect"):
            case.motion.history(0)
        with pytest.raises(NotConnected, match=r"connect"):
            case.motion.move_to(within(case, 0.6))
        with pytest.raises(NotConnected, match=r"connect"):
            case.motion.stop()

    def assert_refused(self, case: MotionCase, goal: Sequence[float], named: str) -> None:
        before = case.motion.read_state()
        with pytest.raises(MoveRefused, match=named):
            case.motion.move_to(goal)
        state = after(case, 0.2)
        assert state.setpoint_rad == before.setpoint_rad
        np.testing.assert_allclose(state.position_rad, before.position_rad, atol=2 * case.step_rad)


@contextmanager
def connected(case: MotionCase) -> Iterator[None]:
    case.motion.connect()
    try:
        yield
    finally:
        case.motion.close()


def within(case: MotionCase, share: float) -> tuple[float, ...]:
    """Set-points at a share of every joint's range; free joints range over a third of a turn each way."""
    third = 2 * math.pi / 3
    lower = [max(limit.lower_rad, -third) for limit in case.motion.limits()]
    upper = [min(limit.upper_rad, third) for limit in case.motion.limits()]
    return tuple(low + share * (high - low) for low, high in zip(lower, upper, strict=True))


def spaced(history: Sequence[JointState], seconds: float) -> list[JointState]:
    """Those read-backs that lie at least that far apart."""
    chosen = [history[0]]
    for state in history[1:]:
        if state.stamp_ns - chosen[-1].stamp_ns >= seconds * SECOND_NS:
            chosen.append(state)
    return chosen


def after(case: MotionCase, seconds: float) -> JointState:
    """The newest reading when that much time has passed."""
    case.clock.sleep_until(case.clock.now_ns() + round(seconds * SECOND_NS))
    return case.motion.read_state()


def settled(case: MotionCase, timeout_s: float = 30.0) -> tuple[bool, JointState]:
    """Whether the joints were seen moving, and the first reading that says they are at rest at the set-points."""
    deadline_ns = case.clock.now_ns() + round(timeout_s * SECOND_NS)
    was_moving = False
    while case.clock.now_ns() < deadline_ns:
        case.clock.sleep_until(case.clock.now_ns() + POLL_NS)
        state = case.motion.read_state()
        was_moving |= state.moving
        away = np.abs(np.subtract(state.position_rad, state.setpoint_rad)).max()
        if not state.moving and away < math.radians(1.0):
            return was_moving, state
    raise AssertionError(f"the joints did not settle within {timeout_s:g} s: {case.motion.read_state()}")
