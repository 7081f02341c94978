"""A simulated rig with late stamps and play: both are found, and looks through the compensated rig are right."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from viewsep.built_rig import SimulatedRig
from viewsep.calibration.compensation import HeldMotion, PunctualCamera, compensated
from viewsep.calibration.turning import measure_timing, steps_of, ticks_of
from viewsep.config import Config, load_config, parse_config
from viewsep.config_file import set_timing
from viewsep.errors import BadConfig, BadInput
from viewsep.geometry import angle_between
from viewsep.interfaces import JointLimits
from viewsep.messages import JointState
from viewsep.moves import move_and_wait
from viewsep.perception import RigPerception
from viewsep.plugins import make_descriptor
from viewsep.rigs import simulated_rig

LATENCY_S, PLAY_DEG = 0.08, 2.0
FREE = JointLimits("pan", -np.inf, np.inf, 1.0)


def late_rig() -> SimulatedRig:
    """A turntable whose camera stamps frames 80 ms after they were exposed, and with 2 degrees of play."""
    config = parse_config(
        {
            "rig": {"preset": "turntable"},
            "sim": {"backlash_deg": PLAY_DEG},
            "camera": {"size_px": 64},
            "descriptor": {"name": "cch"},
        },
        "test",
    )
    simulated = simulated_rig(config, "generated:7", seed=3)
    late = replace(simulated.rig, camera=PunctualCamera(simulated.rig.camera, -LATENCY_S))
    return replace(simulated, rig=late)


@pytest.mark.needs_pybullet
def test_late_stamps_and_play_are_found_on_a_rig() -> None:
    rig, told = late_rig().rig, []
    rig.motion.connect()
    rig.camera.connect()
    try:
        timing = measure_timing(rig, 0, lambda: told.append(1))
        assert rig.motion.read_state().position_rad == pytest.approx((0.0,), abs=0.01)
    finally:
        rig.camera.close()
        rig.motion.close()
    assert timing.latency_s.value == pytest.approx(LATENCY_S, abs=0.005)
    assert np.degrees(timing.play_rad.value) == pytest.approx(PLAY_DEG, abs=0.3)
    assert timing.latency_s.margin < 0.005
    assert np.degrees(timing.play_rad.margin) < 0.3
    assert len(told) == ticks_of(FREE, 0.0)


def errors_deg(simulated: SimulatedRig, config: Config) -> list[float]:
    """How wrong view directions are while the plate turns to and fro."""
    rig, errors = simulated.rig, []
    rig.motion.connect()
    rig.camera.connect()
    perception = RigPerception(compensated(rig, config), make_descriptor(config.descriptor))
    try:
        for goal in (30.0, -10.0):
            rig.motion.move_to([np.radians(goal)])
            for _ in range(5):
                look = perception.look(rig.clock.now_ns() + 200_000_000, 1.0)
                assert look.percept is not None
                exposed_ns = look.stamp_ns - round((LATENCY_S - config.camera.latency_s) * 1e9)
                true = simulated.scene.object_rotation(exposed_ns).T @ rig.geometry.camera_direction
                seen = simulated.scene.grasp_at(0).T @ look.percept.view_direction
                errors.append(float(np.degrees(angle_between(seen, true))))
    finally:
        rig.camera.close()
        rig.motion.close()
    return errors


@pytest.mark.needs_pybullet
def test_looks_through_the_compensated_rig_are_where_the_object_is() -> None:
    plain = late_rig()
    table = plain.config.model_dump(exclude_defaults=True)
    table["rig"] = {"preset": "turntable", "backlash_deg": [PLAY_DEG]}
    table["camera"] = {"size_px": 64, "latency_s": LATENCY_S}
    wrong, right = errors_deg(plain, plain.config), errors_deg(late_rig(), parse_config(table, "test"))
    assert np.max(right[1:]) < 0.15, "after the play was taken up for the first time"
    assert np.max(wrong[1:]) > 1.0


def test_without_a_calibration_the_rig_is_as_it_was() -> None:
    rig = late_rig().rig
    assert compensated(rig, Config()).motion is rig.motion
    assert compensated(rig, Config()).camera is rig.camera


class Remembering:
    """A motion that has turned up and back."""

    states = tuple(
        JointState(k, (float(np.radians(angle)),), (0.0,), True) for k, angle in enumerate([0, 2, 4, 6, 8, 7, 6, 4])
    )

    def __init__(self) -> None:
        self.now = 3

    def history(self, since_ns: int) -> tuple[JointState, ...]:
        known = self.states[: self.now]
        return known[max(sum(state.stamp_ns <= since_ns for state in known) - 1, 0) :]


def test_history_tells_of_the_object_however_often_it_is_asked() -> None:
    motion = Remembering()
    held = HeldMotion(motion, [np.radians(2.0)])  # type: ignore[arg-type]
    assert [round(float(np.degrees(s.position_rad[0])), 6) for s in held.history(0)] == [0.0, 1.0, 3.0]
    motion.now = 8
    again = held.history(3)
    assert [state.stamp_ns for state in again] == [3, 4, 5, 6, 7]
    assert [round(float(np.degrees(s.position_rad[0])), 6) for s in again] == [5.0, 7.0, 7.0, 7.0, 5.0]
    assert held.history(3) == again


def test_stops_stay_within_the_limits() -> None:
    stops = steps_of(JointLimits("tilt", np.radians(-60.0), np.radians(60.0), 1.0), np.radians(50.0))
    assert np.degrees(stops[0]) > -46.1
    assert np.degrees(stops[-1]) < 46.1
    assert len(stops) == 17
    assert np.degrees(steps_of(FREE, np.radians(700.0))).mean() == pytest.approx(700.0, abs=2.1)
    with pytest.raises(BadInput, match="'lid' turns by 40 deg only"):
        steps_of(JointLimits("lid", 0.0, np.radians(40.0), 1.0), 0.0)


def test_what_was_found_is_stored_beside_a_copy(tmp_path: Path) -> None:
    path = tmp_path / "rig.toml"
    path.write_text('# mine\n[rig]\npreset = "pan_tilt"\n')
    backup = set_timing(path, 0.08, [1.5, 2.0])
    assert backup.read_text() == '# mine\n[rig]\npreset = "pan_tilt"\n'
    loaded = load_config(path)
    assert (loaded.camera.latency_s, loaded.rig.backlash_deg) == (0.08, (1.5, 2.0))
    assert path.read_text().startswith("# mine\n")
    with pytest.raises(
        BadConfig, match=r"'rig.backlash_deg' has 1 numbers, but the rig has the joints \['tilt', 'pan'\]"
    ):
        set_timing(path, 0.08, [1.5])
    assert load_config(path) == loaded


@pytest.mark.needs_pybullet
def test_moves_go_by_the_encoders() -> None:
    simulated = late_rig()
    rig = simulated.rig
    held = HeldMotion(rig.motion, [np.radians(PLAY_DEG)])
    held.connect()
    try:
        commanded, state = move_and_wait(held, rig.clock, [np.radians(10.0)], within_rad=0.01)
        assert state.position_rad == pytest.approx(commanded, abs=0.01)
        assert np.degrees(held.history(rig.clock.now_ns())[-1].position_rad[0]) == pytest.approx(9.0, abs=0.2)
    finally:
        held.close()
