"""The whole loop on servos: emulated ones turn the object, a simulated camera follows their joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from viewsep.config import Config, parse_config
from viewsep.errors import BadConfig
from viewsep.kinematics import preset
from viewsep.messages import JointState, Message
from viewsep.models.library import load_library
from viewsep.recordings.reader import read_recording
from viewsep.recordings.replay import verify
from viewsep.rigs import rig_holding
from viewsep.servo_rig import read_backs
from viewsep.session import Rig
from viewsep.sim.clock import PacedClock
from viewsep.sim.dynamixel.motion import EmulatedMotion
from viewsep.task import Task, held_object, run_task


def servo_config(name: str, **changes: Any) -> dict[str, Any]:
    """A preset's rig on emulated servos whose time passes five times as fast."""
    servos = [
        {"joint": joint.name, "id": number, "mode": "position" if joint.upper_rad < 4 else "extended"}
        for number, joint in enumerate(preset(name).limits, 1)
    ]
    servos[-1]["direction"] = -1
    table = {"port": "emulated", "baud": 1_000_000, "emulated_speed": 5.0, "watchdog_s": 2.0, "lost_s": 2.0}
    return {"rig": {"backend": "dynamixel", "preset": name}, "dynamixel": {**table, "servos": servos, **changes}}


class States:
    """Hears the read-backs."""

    def __init__(self) -> None:
        self.heard: list[JointState] = []

    def hear(self, _stamp_ns: int, message: Message) -> None:
        if isinstance(message, JointState):
            self.heard.append(message)


@pytest.mark.alone
@pytest.mark.needs_pybullet
@pytest.mark.parametrize(
    ("name", "seed", "interpreter", "fewest"),
    [
        ("turntable", 6, "path", 20),
        pytest.param("pan_tilt", 1, "path", 20, marks=pytest.mark.long),
        pytest.param("wrist", 5, "filter", 5, marks=pytest.mark.long),  # paths were once undecided
    ],
)
def test_a_twin_is_identified_on_servos_and_the_recording_replays(
    name: str, seed: int, interpreter: str, fewest: int, look_alikes: Path, tmp_path: Path
) -> None:
    models = load_library(look_alikes)
    recording, states = tmp_path / "run.mcap", States()
    source, truth = held_object(models, "product_7", None)
    planner = "separating" if interpreter == "path" else "information"
    method = {"interpreter": {"name": interpreter}, "planner": {"name": planner}}
    table = servo_config(name) | {"sim": {"backlash_deg": 0.3}} | method
    config = parse_config(table, "test")
    answer = run_task(Task(source, truth, seed, recording), config, models, [states])
    assert answer.correct, answer.result.reason
    assert answer.rig == "emulated servos, simulated camera"
    assert len(states.heard) > 100
    assert not any(state.fault for state in states.heard)
    verified = verify(read_recording(recording))
    assert verified.exact
    assert verified.outputs > fewest


@pytest.mark.needs_pybullet
def test_without_the_truth_the_camera_follows_the_read_backs(look_alikes: Path) -> None:
    config = parse_config(servo_config("pan_tilt"), "test")
    held = rig_holding("generated:7", load_library(look_alikes), config, 0)
    motion, clock = held.rig.motion, held.rig.clock
    assert isinstance(motion, EmulatedMotion)
    assert isinstance(clock, PacedClock)
    motion.connect()
    motion.move_to((0.3, 0.5))
    follow = read_backs(motion, clock)
    for _ in range(5):
        stamp_ns = clock.now_ns()
        assert list(follow(stamp_ns)) == pytest.approx(list(motion.joints_at(stamp_ns)), abs=0.02)
    assert isinstance(held.rig, Rig)
    motion.close()


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"port": ""}, r"test: key 'dynamixel.port' is missing: give the servos' serial port"),
        ({"servos": []}, r"test: key 'dynamixel.servos' is for the joints \[\], but the rig has \['tilt', 'pan'\]"),
        ({"baud": 12345}, r"test: key 'dynamixel.baud' = 12345"),
        ({"servos": [{"joint": "tilt", "id": 300}]}, r"test: key 'dynamixel.servos.0.id' = 300"),
        ({"when_stopped": "fall"}, r"test: key 'dynamixel.when_stopped' = 'fall'"),
    ],
)
def test_a_wrong_configuration_names_the_key(changes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(BadConfig, match=sentence):
        parse_config(servo_config("pan_tilt", **changes), "test")


@pytest.mark.needs_pybullet
def test_servos_that_cannot_be_are_refused_before_anything_moves(look_alikes: Path) -> None:
    config = parse_config(servo_config("turntable"), "test")
    servos = tuple(servo.model_copy(update={"mode": "position"}) for servo in config.dynamixel.servos)
    wrong: Config = config.model_copy(update={"dynamixel": config.dynamixel.model_copy(update={"servos": servos})})
    with pytest.raises(BadConfig, match=r"joint 'pan': mode = 'position' reaches .* use mode = 'extended'"):
        rig_holding("generated:7", load_library(look_alikes), wrong, 0)
