"""Simulated time that follows the wall, for several threads at once."""

from __future__ import annotations

import threading
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from view_sets import ring, write_view_set

from viewsep.config import Config
from viewsep.kinematics import preset
from viewsep.rigs import rig_holding
from viewsep.sim.camera import SimCamera
from viewsep.sim.clock import LONGEST_CATCH_UP_S, PacedClock, SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.motion import SimMotion
from viewsep.sim.render import CameraOptics, MeshRenderer
from viewsep.sim.world import STEP_NS, SimWorld

LONGEST_NS = round(LONGEST_CATCH_UP_S * 1e9)


class Wall:
    """A wall clock that is set by hand."""

    def __init__(self) -> None:
        self.now_ns = 5_000

    def __call__(self) -> int:
        return self.now_ns


@given(st.lists(st.integers(0, LONGEST_NS), max_size=20), st.sampled_from([0.3, 1.0, 7.1, 100.0]))
def test_it_runs_at_its_speed_however_it_is_read(waits_ns: list[int], speed: float) -> None:
    wall = Wall()
    clock = PacedClock(speed, 17, wall)
    steps: list[tuple[int, int]] = []
    clock.on_advance = lambda from_ns, to_ns: steps.append((from_ns, to_ns))
    for wait_ns in waits_ns:
        wall.now_ns += wait_ns
        assert abs(clock.now_ns() - 17 - speed * (wall.now_ns - 5_000)) <= 2
    assert [from_ns for from_ns, _ in steps] == [17, *(to_ns for _, to_ns in steps)][: len(steps)]


def test_a_world_that_nobody_read_for_an_hour_stood_still_meanwhile() -> None:
    wall = Wall()
    clock = PacedClock(2.0, 0, wall)
    wall.now_ns += 3600 * 10**9
    assert clock.now_ns() == 2 * LONGEST_NS
    wall.now_ns += 10**9 // 2
    assert clock.now_ns() == 2 * LONGEST_NS + 10**9


def test_waiting_really_waits() -> None:
    clock = PacedClock(4.0)
    begun_ns, start_ns = time.monotonic_ns(), clock.now_ns()
    clock.sleep_until(start_ns + 200_000_000)
    assert clock.now_ns() >= start_ns + 200_000_000
    assert time.monotonic_ns() - begun_ns >= 49_000_000


@pytest.mark.needs_pybullet
@pytest.mark.parametrize("source", ["generated:7", "photos"])
@pytest.mark.parametrize(("speed", "kind"), [(0.0, SimClock), (3.0, PacedClock)])
def test_a_rigs_speed_chooses_its_clock(source: str, speed: float, kind: type[SimClock], tmp_path: Path) -> None:
    held = source if source != "photos" else str(write_view_set(tmp_path / "tin", 1, ring(*range(0, 360, 30))))
    held_rig = rig_holding(held, [], Config(), 0, speed=speed).rig
    assert type(held_rig.clock) is kind
    with closing(held_rig.camera), closing(held_rig.motion):
        held_rig.motion.connect()
        held_rig.camera.connect()
        assert held_rig.camera.read(held_rig.clock.now_ns(), 5.0).stamp_ns > 0


@pytest.mark.needs_pybullet
@pytest.mark.parametrize("clock", [SimClock(), PacedClock(20.0)], ids=["stepped", "paced"])
def test_many_threads_use_one_world(clock: SimClock, product_mesh: Path) -> None:
    world = SimWorld(preset("gimbal"), clock, 0, Disturbances())
    motion, camera = SimMotion(world), SimCamera(world, MeshRenderer(product_mesh, CameraOptics(32)))
    motion.connect()
    camera.connect()
    end_ns = clock.now_ns() + 4 * 10**9
    errors: list[BaseException] = []

    def until_the_end(work: object) -> None:
        assert callable(work)
        try:
            while clock.now_ns() < end_ns:
                work()
        except BaseException as error:
            errors.append(error)

    goals = iter(np.linspace(0.0, 1.0, 10_000))

    def look() -> None:
        before_ns = clock.now_ns()
        assert before_ns < camera.read(before_ns, 5.0).stamp_ns

    def move() -> None:
        motion.move_to([0.0, float(next(goals))])
        clock.sleep_until(clock.now_ns() + 50_000_000)

    def read() -> None:
        stamps = [state.stamp_ns for state in motion.history(clock.now_ns() - 10**9)]
        assert stamps == sorted(set(stamps))
        clock.sleep_until(clock.now_ns() + 20_000_000)

    threads = [threading.Thread(target=until_the_end, args=(work,)) for work in (look, look, move, read, read)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    gaps = {b.stamp_ns - a.stamp_ns for a, b in zip(world.moments, list(world.moments)[1:], strict=False)}
    motion.close()
    camera.close()
    assert errors == []
    assert max(gaps) <= STEP_NS  # no step was lost and none was taken twice
    assert min(gaps) > 0
