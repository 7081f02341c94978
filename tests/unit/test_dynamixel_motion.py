"""How emulated servos move: profiles, play, memory."""

from __future__ import annotations

import math
from itertools import zip_longest

import pytest
from hypothesis import given
from hypothesis import strategies as st
from servo_line import Line, moving_line

from viewsep.drivers.dynamixel.control_table import STEP_RAD
from viewsep.sim.dynamixel.profile import move, run

SPEEDS = st.floats(1.0, 5000.0)


@given(st.floats(-5000, 5000), st.floats(-5000, 5000), st.floats(-5000, 5000), SPEEDS, SPEEDS)
def test_profile_keeps_its_limits(start: float, velocity: float, goal: float, top: float, rate: float) -> None:
    motion = move(start, velocity, goal, top, rate)
    assert motion.position_at(0.0) == pytest.approx(start, abs=1e-6)
    assert motion.position_at(motion.end_s) == goal
    for phase, after in zip_longest(motion.phases, motion.phases[1:]):
        assert phase.duration_s > 0
        assert abs(phase.acceleration) in (0.0, pytest.approx(rate))
        assert abs(phase.velocity_at(phase.end_s)) <= max(top, abs(velocity)) * (1 + 1e-9)
        reached = phase.position_at(phase.end_s)
        assert reached == pytest.approx(after.position if after else goal, abs=1e-2)
        middle = phase.velocity_at(0.5 * (phase.start_s + phase.end_s))
        assert phase.velocity * middle >= 0.0  # no phase turns round


@given(st.floats(-100, 100), st.floats(-900, 900), st.floats(-900, 900), SPEEDS)
def test_constant_velocity_is_reached_and_kept(start: float, velocity: float, speed: float, rate: float) -> None:
    motion = run(start, velocity, speed, rate)
    assert motion.velocity_at(1e4) == pytest.approx(speed)
    assert motion.position_at(0.0) == pytest.approx(start, abs=1e-6)


def test_moves_as_the_profile_says_and_arrives() -> None:
    line = moving_line()
    assert line.write("Goal Position", 3048) == 0
    line.wait(0.6)
    assert line.read("Present Velocity") == 100
    assert line.read("Moving") == 1
    assert line.read("Moving Status") == 0x32  # trapezoid, in progress
    assert 2048 < line.read("Present Position") < 3048
    line.wait(2.0)
    assert (line.read("Present Position"), line.read("Moving"), line.read("Moving Status")) == (3048, 0, 1)
    duration_s = 1000 / (100 * 0.229 * 4096 / 60) + (100 * 0.229 / 60) / (20 * 214.577 / 3600)
    assert line.servo.joint_rad_at(round(duration_s * 1e9)) == pytest.approx(3048 * STEP_RAD, abs=1e-6)
    assert line.servo.joint_rad_at(round((duration_s - 0.1) * 1e9)) < 3047 * STEP_RAD


@given(st.lists(st.tuples(st.floats(0.001, 0.7), st.integers(0, 4095)), min_size=1, max_size=5), st.integers(1, 50))
def test_motion_is_the_same_however_often_it_is_read(goals: list[tuple[float, int]], reads: int) -> None:
    watched, unwatched = moving_line(backlash_rad=0.03), moving_line(backlash_rad=0.03)
    for seconds, goal in goals:
        for line in (watched, unwatched):
            line.write("Goal Position", goal)
        for _ in range(reads):
            watched.wait(seconds / reads)
            watched.read("Present Position")
        unwatched.wait((watched.clock.now_ns() - unwatched.clock.now_ns()) * 1e-9)
    for back_s in (0.0, 0.1, 0.5):
        stamp = watched.clock.now_ns() - round(back_s * 1e9)
        assert watched.servo.joint_rad_at(stamp) == pytest.approx(unwatched.servo.joint_rad_at(stamp), abs=1e-9)


def test_new_goal_in_the_middle_of_a_move_continues_smoothly() -> None:
    line = moving_line()
    line.write("Goal Position", 4000)
    line.wait(1.0)
    before = line.servo.read("Present Velocity")
    line.write("Goal Position", 1000)
    assert line.servo.read("Present Velocity") == before
    line.wait(5.0)
    assert line.read("Present Position") == 1000


def test_time_based_profile_takes_its_time() -> None:
    line = Line()
    assert line.write("Drive Mode", 4) == 0
    for name, value in (("Profile Velocity", 1000), ("Profile Acceleration", 200), ("Torque Enable", 1)):
        line.write(name, value)
    line.write("Goal Position", 2548)
    line.wait(0.95)
    assert line.read("Present Position") < 2548
    line.wait(0.06)
    assert line.read("Present Position") == 2548


def test_joint_lags_behind_by_the_play_in_both_directions() -> None:
    play = math.radians(2.0)
    line = moving_line(backlash_rad=play)
    for goal, side in ((3000, -1), (2000, 1), (3000, -1)):
        line.write("Goal Position", goal)
        line.wait(5.0)
        joint = line.servo.joint_rad_at(line.clock.now_ns())
        assert line.read("Present Position") == goal
        assert joint == pytest.approx(goal * STEP_RAD + side * play / 2, abs=1e-9)
    line.write("Goal Position", 2990)  # within the play: the joint stays
    line.wait(1.0)
    assert line.servo.joint_rad_at(line.clock.now_ns()) == pytest.approx(joint, abs=1e-12)


def test_past_moments_are_remembered_for_twenty_seconds() -> None:
    line = moving_line()
    places = []
    for goal in (2500, 1500) * 20:
        line.write("Goal Position", goal)
        line.wait(1.0)
        places.append((line.clock.now_ns(), line.servo.joint_rad_at(line.clock.now_ns())))
    for stamp, place in places[-20:]:
        assert line.servo.joint_rad_at(stamp) == pytest.approx(place, abs=1e-9)
