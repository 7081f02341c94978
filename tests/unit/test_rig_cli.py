"""`viewsep rig` on emulated servos, and on a device that is not ours."""

from __future__ import annotations

import os
import re
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from serial.tools.list_ports_common import ListPortInfo
from shell import Shell

from viewsep.clock import MonotonicClock
from viewsep.config import load_config
from viewsep.sim.dynamixel.bus import EmulatedBus
from viewsep.sim.dynamixel.packets import with_crc
from viewsep.sim.dynamixel.port import EmulatedPort
from viewsep.sim.dynamixel.presets import PRESETS, emulated_bus
from viewsep.sim.dynamixel.servo import EmulatedServo


@pytest.fixture
def bus() -> EmulatedBus:
    return emulated_bus("pan_tilt", MonotonicClock())


@pytest.fixture
def port(bus: EmulatedBus) -> Iterator[str]:
    with EmulatedPort(bus) as port:
        yield port.name


@pytest.fixture
def config(shell: Shell, port: str, tmp_path: Path) -> str:
    file = tmp_path / "rig.toml"
    assert shell("rig", "init", "--preset", "pan_tilt", "--port", port, "-o", str(file)).code == 0
    return str(file)


@contextmanager
def pinged_only() -> Iterator[str]:
    """A device that knows Ping and nothing else: id 9, model 0x7777, firmware 3. Written from the e-manual."""
    master, slave = os.openpty()
    tty.setraw(slave)
    answer = with_crc(bytes.fromhex("FFFFFD000907005500777703"))

    def serve() -> None:
        heard = b""
        while True:
            try:
                heard += os.read(master, 64)
            except OSError:
                return
            for asked in (0x09, 0xFE):
                ping = bytes([0xFF, 0xFF, 0xFD, 0x00, asked, 0x03, 0x00, 0x01])
                if ping in heard:
                    heard = b""
                    os.write(master, answer)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield os.ttyname(slave)
    finally:
        os.close(slave)
        thread.join(5.0)
        os.close(master)


@pytest.mark.parametrize("preset", PRESETS)
def test_init_writes_a_configuration_that_loads(shell: Shell, tmp_path: Path, preset: str) -> None:
    file = tmp_path / "rig.toml"
    assert shell("rig", "init", "--preset", preset, "-o", str(file)).code == 0
    config = load_config(file)
    assert config.rig.preset == preset
    assert config.dynamixel.port == "emulated"
    assert [servo.id for servo in config.dynamixel.servos] == list(PRESETS[preset])
    for key in type(config.dynamixel).model_fields:
        assert f"\n{key} = " in file.read_text() or key == "servos"
    before = file.read_text()
    again = shell("rig", "init", "--preset", "wrist", "-o", str(file))
    assert (again.code, file.read_text()) == (2, before)
    assert "exists: choose another name" in again.err
    assert shell("rig", "init", "--preset", "wrist", "-o", str(file), "--force").code == 0
    assert file.read_text() != before or preset == "wrist"


@pytest.mark.parametrize("preset", ["turntable", "pan_tilt"])
def test_init_writes_the_camera_too(shell: Shell, tmp_path: Path, preset: str) -> None:
    file = tmp_path / 'my "rig".toml'
    background = str(tmp_path / 'my "rig"_background.npz')
    ended = shell("rig", "init", "--preset", preset, "--camera", "staged", "-o", file)
    assert f"next: viewsep rig background -c {file}" in " ".join(ended.err.split())
    staged = load_config(file)
    assert (staged.camera.source, staged.sim.placed) == (
        "staged",
        "standing" if preset == "turntable" else "anyhow",
    )
    assert (staged.perception.method, staged.perception.background) == ("background", background)
    assert staged.perception.object_radius_px == round(0.94 * staged.stage.object_px / 2)
    device = ["--port", "/dev/ttyUSB0", "--camera", "v4l2", "--device", "/dev/v4l/by-id/usb-046d"]
    assert "next: viewsep rig doctor" in shell("rig", "init", "--preset", preset, *device, "-o", file, "--force").err
    real = load_config(file)
    assert (real.camera.source, real.v4l2.device) == ("v4l2", "/dev/v4l/by-id/usb-046d")
    assert (real.perception.background, real.perception.object_radius_px) == (background, 0.0)


@pytest.mark.parametrize(
    ("typed", "sentence"),
    [
        (["--camera", "v4l2"], "--camera v4l2 needs --device PATH, the camera's name: `viewsep camera list`"),
        (["--device", "/dev/video0"], "--device '/dev/video0' goes with --camera v4l2"),
        (["--camera", "v4l2", "--device", 'a"b'], "is no name of a camera"),
    ],
)
def test_init_says_what_is_missing_of_the_camera(shell: Shell, tmp_path: Path, typed: list[str], sentence: str) -> None:
    ended = shell("rig", "init", "--preset", "turntable", *typed, "-o", tmp_path / "rig.toml")
    assert (ended.code, list(tmp_path.iterdir())) == (2, [])
    assert sentence in " ".join(ended.err.split())


def test_a_servo_gets_another_id(shell: Shell, bus: EmulatedBus, port: str) -> None:
    ended = shell("rig", "set-id", "--port", port, "--id", 1, "--to", 7)
    assert (ended.code, "servo 1 (XL430-W250) has id 7 now" in ended.err) == (0, True)
    assert [servo["ID"] for servo in bus.servos] == [7, 2]
    refused: list[tuple[list[str | int | Path], str]] = [
        (["--to", 3], "servos 2, 7 are on"),
        (["--id", 1, "--to", 3], "--id 1: the servos on"),
        (["--id", 7, "--to", 2], "has that id already"),
        (["--to", 3, "--baud", 1_000_000], "no servo answers on"),
        (["--to", 3, "--baud", 1234], "--baud 1234: servos know"),
    ]
    for typed, sentence in refused:
        ended = shell("rig", "set-id", "--port", port, *typed)
        assert (ended.code, sentence in " ".join(ended.err.split())) == (2, True), ended.err
    bus.servos[0].poke("Torque Enable", 1)
    ended = shell("rig", "set-id", "--port", port, "--id", 7, "--to", 3)
    assert "switch its power off and on" in " ".join(ended.err.split())
    assert [servo["ID"] for servo in bus.servos] == [7, 2]


def test_ports_are_listed_with_the_names_that_stay(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = tmp_path / "ttyUSB7"
    device.touch()
    (tmp_path / "by-id").mkdir()
    (tmp_path / "by-id" / "usb-FTDI_1234").symlink_to(device)
    found = ListPortInfo(str(device))
    found.description = "USB Serial"
    monkeypatch.setattr("viewsep.cli.rig_ports.BY_ID", tmp_path / "by-id")
    monkeypatch.setattr("viewsep.cli.rig_ports.comports", lambda: [found])
    stable = str(tmp_path / "by-id" / "usb-FTDI_1234")
    expected = [{"port": str(device), "by_id": stable, "description": "USB Serial", "latency_ms": None}]
    assert shell("rig", "ports", "--json").json == expected
    assert "USB Serial" in shell("rig", "ports").out
    monkeypatch.setattr("viewsep.cli.rig_ports.comports", list)
    none = shell("rig", "ports")
    assert (none.code, none.out) == (1, "")
    assert "no serial port: plug the adapter in" in none.err


@pytest.mark.parametrize("port", ["", "a\nb", "tty\x07", 'tty"', "C:\\1"])
def test_init_writes_nothing_for_what_is_no_port(shell: Shell, tmp_path: Path, port: str) -> None:
    file = tmp_path / "rig.toml"
    ended = shell("rig", "init", "--preset", "turntable", "--port", port, "-o", str(file))
    assert (ended.code, file.exists()) == (2, False)
    assert "is no name of a port" in " ".join(ended.err.split())


def test_scan_prints_id_model_firmware_and_baud(shell: Shell, port: str) -> None:
    ended = shell("rig", "scan", "--port", port, "--baud", "57600", "--json")
    assert ended.code == 0
    assert ended.json == [{"id": i, "model": "XL430-W250", "firmware": 47, "baud": 57600} for i in (1, 2)]
    nobody = shell("rig", "scan", "--port", port, "--baud", "1000000")
    assert (nobody.code, nobody.out) == (1, "")
    assert "no servo answers" in nobody.err


def test_doctor_finds_nothing_wrong_with_good_servos(shell: Shell, config: str) -> None:
    ended = shell("rig", "doctor", "--config", config, "--json")
    assert ended.code == 0, ended.out
    verdicts = {check["check"]: check["verdict"] for check in ended.json}
    assert verdicts["servo 1 (joint 'tilt'): model"] == "pass"
    assert verdicts["servo 2 (joint 'pan'): limits"] == "pass"
    assert verdicts["servo 2 (joint 'pan'): operating mode"] == "could be better"  # it is still in position mode
    assert verdicts["servo 1 (joint 'tilt'): return delay"] == "could be better"
    assert "fail" not in verdicts.values()


def test_doctor_says_what_is_wrong_and_what_to_do(shell: Shell, bus: EmulatedBus, config: str) -> None:
    bus[1].temperature_c = 80
    bus[1].poke("Max Position Limit", 2100)
    bus[2].silent = True
    ended = shell("rig", "doctor", "--config", config)
    assert ended.code == 1
    said = " ".join(ended.out.replace("│", " ").split())
    for words in ("no answer", "80 of at most", "let it cool", "too narrow"):
        assert words in said


def test_scan_and_doctor_work_on_a_device_that_is_not_ours(shell: Shell) -> None:
    with pinged_only() as name:
        ended = shell("rig", "scan", "--port", name, "--baud", "57600", "--json")
        assert ended.code == 0, ended.err
        assert ended.json == [{"id": 9, "model": "model 30583", "firmware": 3, "baud": 57600}]
        ended = shell("rig", "doctor", "--port", name, "--json")
        assert ended.code == 0, ended.err
        assert {"check": "servo 9: model", "verdict": "pass", "found": "model 30583", "remedy": ""} in ended.json


def test_jog_turns_one_joint(shell: Shell, bus: EmulatedBus, config: str) -> None:
    ended = shell("rig", "jog", "--config", config, "--joint", "tilt", "--by-deg", "5")
    assert ended.code == 0, ended.err
    assert "tilt: 5.01 deg, set-point 5.01 deg" in ended.out
    assert (bus[1].counts, bus[2].counts) == (2048 + 57, 2048)
    assert bus[1]["Torque Enable"] == 1
    assert bus[1]["Bus Watchdog"] == 0


def test_a_dry_run_prints_the_packets_and_moves_nothing(shell: Shell, bus: EmulatedBus, config: str) -> None:
    ended = shell("rig", "jog", "--config", config, "--joint", "tilt", "--to-deg", "-10", "--dry-run")
    assert ended.code == 0, ended.err
    assert "FF FF FD 00 01 06 00 03 40 00 01 DB 66  servo 1: Torque Enable = 1" in ended.out
    *_, last, ending = ended.out.splitlines()
    assert last.endswith("  servo 1: Goal Position = 1934, servo 2: Goal Position = 2048")
    assert ending == "nothing was sent; it would end at tilt -10.02 deg, pan 0.00 deg"
    assert (bus[1].counts, bus[1]["Torque Enable"]) == (2048, 0)


def test_dry_runs_of_home_and_calibrate(shell: Shell, bus: EmulatedBus, config: str) -> None:
    bus[1].turn_by_hand(0.2)
    before = Path(config).read_bytes()
    ended = shell("rig", "home", "--config", config, "--dry-run")
    assert ended.out.endswith("nothing was sent; it would end at tilt 0.00 deg, pan 0.00 deg\n")
    ended = shell("rig", "calibrate", "--config", config, "--joint", "pan", "--repeats", "2", "--dry-run")
    assert ended.code == 0, ended.err
    moves = [line for line in ended.out.splitlines() if " 83 74 00 04 00 01 " in line]  # Sync Write of Goal Position
    assert len(moves) == 2 * 3 * 2 * 2
    assert all("servo 1: Goal Position = 2178, " in line for line in moves)
    assert (bus[1].counts, bus[1]["Torque Enable"], bus[2]["Torque Enable"]) == (2178, 0, 0)
    assert Path(config).read_bytes() == before


def test_home_drives_every_joint_to_zero(shell: Shell, bus: EmulatedBus, config: str) -> None:
    bus[2].turn_by_hand(0.2)
    ended = shell("rig", "home", "--config", config)
    assert ended.code == 0, ended.err
    assert ended.out == "tilt: 0.00 deg\npan: 0.00 deg\n"
    assert (bus[1].counts, bus[2].counts) == (2048, 2048)


def test_a_zero_found_by_hand_is_saved_beside_a_copy_of_the_file(shell: Shell, bus: EmulatedBus, config: str) -> None:
    before = Path(config).read_text()
    turned = threading.Timer(0.5, bus[2].turn_by_hand, (0.3,))
    turned.start()
    ended = shell("rig", "home", "--config", config, "--joint", "pan", "--by-hand", "--seconds", "1")
    turned.join()
    assert ended.code == 0, ended.err
    assert [servo.zero_counts for servo in load_config(Path(config)).dynamixel.servos] == [2048, 2048 + 196]
    assert Path(f"{config}.bak").read_text() == before
    assert bus[2]["Torque Enable"] == 1
    assert Path(config).read_text().count("#") == before.count("#")
    assert shell("rig", "home", "--config", config, "--joint", "pan", "--by-hand", "--seconds", "1").code == 0
    assert Path(f"{config}.bak.1").exists()


@pytest.mark.parametrize(("model", "effort"), [("XL430-W250", "0.2"), ("XM430-W350", "0.2")])
def test_a_zero_found_at_a_mechanical_stop(shell: Shell, tmp_path: Path, model: str, effort: str) -> None:
    servo = EmulatedServo(1, model, clock=MonotonicClock())
    servo.mechanical_stops = (1500, 2300)
    file = str(tmp_path / "rig.toml")
    with EmulatedPort(EmulatedBus([servo])) as port:
        assert shell("rig", "init", "--preset", "turntable", "--port", port.name, "-o", file).code == 0
        options = ("--joint", "pan", "--at-stop", "--stop-deg", "30", "--effort", effort)
        ended = shell("rig", "home", "--config", file, *options)
    assert ended.code == 0, ended.err
    (found,) = load_config(Path(file)).dynamixel.servos
    assert found.zero_counts == pytest.approx(2300 - 30 / 360 * 4096, abs=3)
    assert servo["Hardware Error Status"] == 0
    assert servo["Operating Mode"] == 4
    assert servo.counts < 2280  # it has backed off
    assert servo["Goal PWM"] == servo["PWM Limit"]


def test_without_a_stop_it_says_so_and_saves_nothing(shell: Shell, bus: EmulatedBus, config: str) -> None:
    before = Path(config).read_text()
    bus[2].poke("Profile Acceleration", 0)
    options = ("--joint", "pan", "--at-stop", "--stop-deg", "30", "--backwards")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("viewsep.drivers.dynamixel.homing.SPEED_RAD_S", 5.0)
        ended = shell("rig", "home", "--config", config, *options)
    assert ended.code == 1
    assert "met no mechanical stop within one turn" in " ".join(ended.err.split())
    assert Path(config).read_text() == before


def test_calibrate_measures_what_the_encoder_sees(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A servo that rests 3 counts beside its goals: the tolerance is raised, with a copy of the file before."""
    monkeypatch.setattr("viewsep.repeatability.REACH_RAD", 0.1)
    monkeypatch.setattr("viewsep.repeatability.TARGETS", (0.0, 0.05))
    servo = EmulatedServo(1, clock=MonotonicClock(), goal_error=3)
    file = tmp_path / "rig.toml"
    with EmulatedPort(EmulatedBus([servo])) as port:
        assert shell("rig", "init", "--preset", "turntable", "--port", port.name, "-o", str(file)).code == 0
        ended = shell("rig", "calibrate", "--config", str(file), "--repeats", "1", "--json")
    assert ended.code == 0, ended.err
    (pan,) = ended.json
    assert abs(pan["from_below_deg"]) == pytest.approx(3 * 360 / 4096, abs=0.05)
    assert pan["spread_deg"] < 0.05
    assert load_config(file).dynamixel.settle_within_deg == pytest.approx(0.8)
    assert load_config(Path(f"{file}.bak")).dynamixel.settle_within_deg == 0.5


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("jog", "--joint", "roll", "--by-deg", "1"), "--joint 'roll': the joints in .* are tilt, pan"),
        (("jog", "--joint", "pan", "--by-deg", "inf", "--dry-run"), "joint 'pan': set-point inf deg is outside"),
        (("jog", "--joint", "pan"), "give --by-deg or --to-deg"),
        (("home", "--joint", "pan", "--by-hand", "--dry-run"), "--dry-run goes without --by-hand and --at-stop"),
        (("home", "--joint", "pan"), "--joint goes with --by-hand or --at-stop"),
        (("home", "--joint", "pan", "--at-stop"), "--at-stop needs --stop-deg"),
        (("home", "--joint", "pan", "--at-stop", "--by-hand"), "exclude each other"),
        (("calibrate", "--joint", "roll"), "--joint 'roll': the joints in .* are tilt, pan"),
        (("jog", "--joint", "tilt", "--to-deg", "80"), "joint 'tilt': set-point 80.00 deg is outside"),
    ],
)
def test_bad_input_gets_one_sentence(shell: Shell, config: str, arguments: tuple[str, ...], sentence: str) -> None:
    ended = shell("rig", *arguments, "--config", config)
    assert ended.code in (1, 2)
    assert "Traceback" not in ended.err
    assert re.search(sentence, " ".join(ended.err.split()))


def test_without_servos_there_is_nothing_to_set_up(shell: Shell, tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    shell("rig", "init", "--preset", "turntable", "-o", str(file))
    ended = shell("rig", "doctor", "--config", str(file))
    assert ended.code == 2
    assert "dynamixel.port = 'emulated': there is nothing to set up" in " ".join(ended.err.split())


def test_a_port_that_is_not_there_is_named(shell: Shell) -> None:
    ended = shell("rig", "scan", "--port", "/dev/ttyNOWHERE", "--baud", "57600")
    assert ended.code == 1
    assert "there is no serial port /dev/ttyNOWHERE" in " ".join(ended.err.split())
    assert shell("rig", "scan", "--port", "/dev/ttyNOWHERE", "--baud", "5").code == 2


@pytest.mark.parametrize("name", ["/dev/null", "/dev", __file__])
def test_what_is_no_serial_port_is_not_taken_for_one(shell: Shell, name: str) -> None:
    ended = shell("rig", "scan", "--port", name, "--baud", "57600")
    assert ended.code == 1
    assert f"{name} is no serial port: `viewsep rig ports` lists them" in " ".join(ended.err.split())
