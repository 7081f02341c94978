"""Zeros that are found where the file was wrong, and what becomes of a servo when finding one is interrupted."""

from __future__ import annotations

import os
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from shell import Ended, Shell

from viewsep.clock import MonotonicClock
from viewsep.config import load_config
from viewsep.sim.dynamixel.bus import EmulatedBus
from viewsep.sim.dynamixel.port import EmulatedPort
from viewsep.sim.dynamixel.servo import EmulatedServo

TILT = """
[rig]
backend = "dynamixel"
[[rig.joints]]
name = "tilt"
axis = [0, 1, 0]
lower_deg = -60
upper_deg = 60
max_speed_deg_s = 60
[dynamixel]
port = "{port}"
baud = 1000000
[[dynamixel.servos]]
joint = "tilt"
id = 1
"""


@dataclass
class Bench:
    """One servo, a configuration of it, and what is typed."""

    servo: EmulatedServo
    file: Path
    shell: Shell

    def home(self, *options: str) -> Ended:
        return self.shell("rig", "home", "--config", self.file, "--joint", "tilt", *options)

    @property
    def zero(self) -> int:
        return load_config(self.file).dynamixel.servos[0].zero_counts

    def meanwhile(self, happens: Callable[[], bool], act: Callable[[], None]) -> threading.Thread:
        """Does something as soon as something else has happened."""

        def wait() -> None:
            until_s = time.monotonic() + 10.0
            while time.monotonic() < until_s:
                if happens():
                    act()
                    return
                time.sleep(0.01)

        thread = threading.Thread(target=wait, daemon=True)
        thread.start()
        return thread

    def ctrl_c(self, happens: Callable[[], bool]) -> threading.Thread:
        """Presses it when something has happened, if the command listens to it then: pytest would, too."""
        of_pytest = signal.getsignal(signal.SIGINT)

        def press() -> None:
            if signal.getsignal(signal.SIGINT) is not of_pytest:
                os.kill(os.getpid(), signal.SIGINT)

        return self.meanwhile(happens, press)


@pytest.fixture
def bench(tmp_path: Path, shell: Shell) -> Iterator[Bench]:
    servo = EmulatedServo(1, clock=MonotonicClock(), baud=1_000_000, position=2048)
    file = tmp_path / "rig.toml"
    with EmulatedPort(EmulatedBus([servo])) as port:
        file.write_text(TILT.format(port=port.name))
        yield Bench(servo, file, shell)


def test_by_hand_even_where_the_file_and_the_servos_limits_do_not_agree(bench: Bench) -> None:
    """The old zero would have been refused: the servo turns from 1700 to 3400 only."""
    bench.servo.poke("Min Position Limit", 1700)
    bench.servo.poke("Max Position Limit", 3400)
    assert bench.shell("rig", "home", "--config", bench.file).code == 1
    turning = bench.meanwhile(lambda: not bench.servo["Torque Enable"], lambda: bench.servo.turn_by_hand(0.75))
    ended = bench.home("--by-hand", "--seconds", "1")
    turning.join()
    assert ended.code == 0, ended
    assert bench.zero == bench.servo.counts == 2048 + 489
    assert bench.servo["Torque Enable"] == 1
    assert bench.shell("rig", "home", "--config", bench.file).out == "tilt: 0.00 deg\n"


@pytest.mark.parametrize(("model", "start", "stop"), [("XL430-W250", 4000, 4096 + 100), ("XM430-W350", 2048, 2731)])
def test_at_a_stop_in_position_mode(bench: Bench, model: str, start: int, stop: int) -> None:
    """The stop may be beyond the turn that position mode knows."""
    servo = EmulatedServo(1, model, clock=MonotonicClock(), baud=1_000_000, position=start)
    servo.mechanical_stops = (start - 800, stop)
    with EmulatedPort(EmulatedBus([servo])) as port:
        bench.file.write_text(TILT.format(port=port.name))
        ended = bench.home("--at-stop", "--stop-deg", "90")
    assert ended.code == 0, ended
    assert bench.zero == pytest.approx(stop - 1024, abs=2)
    assert servo["Operating Mode"] == 3
    assert servo["Goal PWM"] == servo["PWM Limit"]
    assert (servo["Torque Enable"], servo["Bus Watchdog"]) == (1, 0)


def test_too_weak_to_move_is_not_at_the_stop(bench: Bench) -> None:
    before = bench.file.read_bytes()
    bench.servo.load = 0.5
    ended = bench.home("--at-stop", "--stop-deg", "90", "--effort", "0.2")
    assert ended.code == 1
    assert "did not move: raise --effort, or turn the joint away from the stop" in " ".join(ended.err.split())
    assert bench.file.read_bytes() == before
    assert bench.servo["Operating Mode"] == 3


def test_a_servo_that_gives_up_is_not_at_the_stop(bench: Bench) -> None:
    before = bench.file.read_bytes()
    failing = bench.meanwhile(lambda: bench.servo.counts > 2100, bench.servo.overload)
    ended = bench.home("--at-stop", "--stop-deg", "90")
    failing.join()
    assert ended.code == 1
    assert "it was overloaded" in ended.err
    assert bench.file.read_bytes() == before


def test_an_alert_from_before_is_cleared_first(bench: Bench) -> None:
    bench.servo.overload()
    bench.servo.mechanical_stops = (1300, 2300)
    assert bench.home("--at-stop", "--stop-deg", "65").code == 0
    assert bench.zero == pytest.approx(2300 - 740, abs=2)
    assert bench.servo["Hardware Error Status"] == 0


def test_a_zero_from_where_the_limits_cannot_be_reached_is_not_saved(bench: Bench) -> None:
    before = bench.file.read_bytes()
    bench.servo.poke("Present Position", 300)
    ended = bench.home("--by-hand", "--seconds", "1")
    assert ended.code == 2
    said = " ".join(ended.err.split())
    assert "zero_counts = 300 was found but not saved: joint 'tilt': mode = 'position' reaches 0 to 4095" in said
    assert bench.file.read_bytes() == before


def test_ctrl_c_on_the_way_to_a_stop(bench: Bench) -> None:
    before = bench.file.read_bytes()
    pressing = bench.ctrl_c(lambda: bench.servo.counts > 2100)
    ended = bench.home("--at-stop", "--stop-deg", "90")
    pressing.join()
    assert ended.code == 130
    assert "stopped before it met its mechanical stop" in " ".join(ended.err.split())
    assert bench.file.read_bytes() == before
    assert bench.servo.counts < 2200
    assert (bench.servo["Operating Mode"], bench.servo["Torque Enable"], bench.servo["Moving"]) == (3, 1, 0)
    assert bench.servo["Goal PWM"] == bench.servo["PWM Limit"]


def test_while_it_presses_a_watchdog_watches_over_it(bench: Bench) -> None:
    """Whoever dies while the joint is driven leaves it standing."""
    seen: list[int] = []
    looking = bench.meanwhile(lambda: bench.servo.counts > 2060, lambda: seen.append(bench.servo["Bus Watchdog"]))
    bench.servo.mechanical_stops = (1000, 2110)
    assert bench.home("--at-stop", "--stop-deg", "60").code == 0
    looking.join()
    assert seen == [25]


@pytest.mark.parametrize("command", [("jog", "--joint", "tilt", "--to-deg", "30"), ("home",)])
def test_a_joint_that_does_not_arrive_is_an_error(bench: Bench, command: tuple[str, ...]) -> None:
    bench.servo.poke("Present Position", 1900)
    bench.servo.mechanical_stops = (1890, 1950)
    ended = bench.shell("rig", *command, "--config", bench.file)
    assert ended.code == 1, ended
    assert re.search("did not arrive in time|it was overloaded", ended.err)
    assert ended.out == ""


def test_ctrl_c_stops_a_jog(bench: Bench) -> None:
    stopping = bench.ctrl_c(lambda: bench.servo.counts > 2100)
    ended = bench.shell("rig", "jog", "--config", bench.file, "--joint", "tilt", "--to-deg", "59")
    stopping.join()
    assert ended.code == 130
    assert ended.out.startswith("tilt: ")
    assert bench.servo.counts < 2048 + 59 / 360 * 4096 - 100
    assert bench.servo["Bus Watchdog"] == 0


def test_servos_that_answer_little_are_homed_as_well(bench: Bench) -> None:
    bench.servo.poke("Status Return Level", 0)
    assert bench.home("--by-hand", "--seconds", "1").code == 0
    assert bench.servo["Status Return Level"] == 2
    assert bench.zero == 2048
