"""What `viewsep rig doctor` says of emulated servos of which one thing is not as it should be."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from shell import Shell

from viewsep.clock import MonotonicClock
from viewsep.sim.dynamixel.bus import EmulatedBus
from viewsep.sim.dynamixel.faults import Fault, Kind
from viewsep.sim.dynamixel.port import EmulatedPort
from viewsep.sim.dynamixel.servo import EmulatedServo

BAUD = 1_000_000


@dataclass
class Bench:
    """Servo 1 of a turntable on its bus, and the doctor."""

    bus: EmulatedBus
    config: Path
    shell: Shell

    def doctor(self, *options: str, code: int = 0) -> dict[str, tuple[str, str, str]]:
        """Verdict, what was found and the remedy, by the check's name."""
        ended = self.shell("rig", "doctor", "--config", self.config, "--json", *options)
        assert ended.code == code, ended
        return {check["check"]: (check["verdict"], check["found"], check["remedy"]) for check in ended.json}


def servo(**settings: int) -> EmulatedServo:
    return EmulatedServo(1, clock=MonotonicClock(), baud=BAUD, **settings)  # type: ignore[arg-type]


@pytest.fixture
def emulated() -> EmulatedServo:
    return servo()


@pytest.fixture
def bench(emulated: EmulatedServo, shell: Shell, tmp_path: Path) -> Iterator[Bench]:
    bus = EmulatedBus([emulated])
    file = tmp_path / "rig.toml"
    with EmulatedPort(bus) as port:
        written = shell("rig", "init", "--preset", "turntable", "--port", port.name, "--baud", BAUD, "-o", file)
        assert written.code == 0
        file.write_text(file.read_text().replace('mode = "extended"', 'mode = "position"'))
        limits = '\n[[rig.joints]]\nname = "pan"\naxis = [0, 0, 1]\nlower_deg = -90\nupper_deg = 90\n'
        text = file.read_text().replace('preset = "turntable"', "").replace("camera_elevation_deg = 25", "")
        file.write_text("\n".join(line for line in text.splitlines() if not line.lstrip().startswith("#")) + limits)
        yield Bench(bus, file, shell)


Pokes = dict[str, int]
Said = dict[str, str]
BETTER: tuple[Pokes, Said] = (
    {
        "Return Delay Time": 100,
        "Status Return Level": 1,
        "Operating Mode": 4,
        "Shutdown": 0b010000,
        "Present Input Voltage": 138,
        "Present Position": 3800,
    },
    {
        "return delay": "200 us",
        "status return level": "viewsep sets 2 when it connects",
        "operating mode": "viewsep sets 3 when it connects",
        "shutdown": "overheating and overload should take its torque off: set Shutdown to 52",
        "rated voltage": "XL430-W250 is made for 6.5 to 12.0 V",
        "angle": "the rig turns it from -90 to 90 deg only",
    },
)
BAD: tuple[Pokes, Said] = (
    {
        "Max Position Limit": 2500,
        "Hardware Error Status": 0b100000,
        "Present Temperature": 80,
        "Present Input Voltage": 51,
    },
    {
        "limits": "the servo's Min and Max Position Limit are 0 and 2500",
        "hardware": "it was overloaded: remove what blocks the joint",
        "temperature": "80 of at most 72 degC",
        "supply": "5.1 V, allowed 6.0 to 14.0 V",
    },
)
SLOW: tuple[Pokes, Said] = ({"Velocity Limit": 10}, {"limits": "above the servo's Velocity Limit of 14 deg/s"})


@pytest.mark.parametrize(
    ("pokes", "said", "verdict"),
    [(*BETTER, "could be better"), (*BAD, "fail"), (*SLOW, "fail")],
    ids=["better", "bad", "slow"],
)
def test_it_says_what_is_not_as_it_should_be(
    bench: Bench, emulated: EmulatedServo, pokes: Pokes, said: Said, verdict: str
) -> None:
    for register, value in pokes.items():
        emulated.poke(register, value)
    checks = bench.doctor(code=int(verdict == "fail"))
    found = {name.removeprefix("servo 1 (joint 'pan'): "): check for name, check in checks.items()}
    for name, words in said.items():
        assert found[name][0] == verdict, name
        assert words in " ".join(found[name][1:])
    assert {name for name, check in found.items() if check[0] == verdict} == set(said)


@pytest.mark.parametrize("emulated", [servo(firmware=37)])
def test_old_firmware_has_no_watchdog(bench: Bench) -> None:
    verdict, found, remedy = bench.doctor(code=1)["servo 1 (joint 'pan'): firmware"]
    assert (verdict, found) == ("fail", "37")
    assert "before 38 there is no bus watchdog" in remedy


def test_fix_sets_the_return_delay_and_nothing_else(bench: Bench, emulated: EmulatedServo) -> None:
    def eeprom() -> dict[str, int]:
        names = ("Return Delay Time", "Operating Mode", "Status Return Level", "Shutdown", "Max Position Limit")
        return {name: emulated[name] for name in names}

    emulated.poke("Shutdown", 0)
    before = eeprom()
    assert bench.doctor("--fix")["servo 1 (joint 'pan'): return delay"] == ("pass", "500 us, now 0 us", "")
    assert eeprom() == {**before, "Return Delay Time": 0}


def test_fix_does_not_let_a_held_joint_fall(bench: Bench, emulated: EmulatedServo) -> None:
    emulated.poke("Torque Enable", 1)
    verdict, found, remedy = bench.doctor("--fix")["servo 1 (joint 'pan'): return delay"]
    assert (verdict, found) == ("could be better", "500 us")
    assert "while the torque is off only" in remedy
    assert emulated["Torque Enable"] == 1


@pytest.mark.parametrize("kind", [Kind.LOST, Kind.CORRUPT])
def test_a_bad_line_is_measured(bench: Bench, kind: Kind) -> None:
    for reply in (40, 50, 60):
        bench.bus.faults.add(Fault(kind, nth=reply))
    verdict, found, remedy = bench.doctor(code=1)["line"]
    assert (verdict, remedy) == ("fail", "check plugs, cable length and termination")
    assert found.startswith("3 of 50 states of 1 servos failed, ")


def test_a_slow_baud_is_counted_out(bench: Bench) -> None:
    many = [EmulatedServo(number, clock=MonotonicClock(), baud=57600) for number in range(1, 6)]
    with EmulatedPort(EmulatedBus(many)) as port:
        ended = bench.shell("rig", "doctor", "--port", port.name, "--json")
    assert ended.code == 0
    (found,) = [check for check in ended.json if check["check"] == "baud"]
    assert (found["verdict"], found["found"]) == ("could be better", "57600: at most 39 states of 5 servos per second")
    assert found["remedy"] == "set the servos and dynamixel.baud to 1000000"


def test_a_port_that_is_gone_is_a_failed_check(bench: Bench) -> None:
    bench.config.write_text(bench.config.read_text().replace('port = "/dev/pts', 'port = "/dev/nowhere'))
    verdict, found, remedy = bench.doctor(code=1)["port"]
    assert (verdict, found[:12]) == ("fail", "/dev/nowhere")
    assert remedy.startswith("there is no serial port /dev/nowhere")
