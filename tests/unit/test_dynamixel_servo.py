"""Emulated servos on simulated time: registers, instructions, alerts, other modes."""

from __future__ import annotations

import math

import pytest
from servo_line import Line, moving_line

from viewsep.drivers.dynamixel.control_table import STEP_RAD, model_number
from viewsep.errors import RigError
from viewsep.sim.clock import SimClock
from viewsep.sim.dynamixel.models import MODELS
from viewsep.sim.dynamixel.packets import ALERT, Code, Error, Instruction, Parser, Status, encode, with_crc
from viewsep.sim.dynamixel.servo import EmulatedServo


def test_goal_outside_the_limits_moves_nothing() -> None:
    line = Line()
    line.write("Max Position Limit", 3000)
    line.write("Torque Enable", 1)
    assert line.write("Goal Position", 3001) == Error.DATA_LIMIT
    line.wait(1.0)
    assert (line.read("Goal Position"), line.read("Present Position")) == (2048, 2048)
    assert line.write("Goal Velocity", 266) == Error.DATA_LIMIT
    assert line.write("Goal PWM", -886) == Error.DATA_LIMIT


@pytest.mark.parametrize(
    ("address", "data", "error"),
    [
        (0, b"\x00\x00", Error.ACCESS),  # read only
        (132, b"\x00\x00\x00\x00", Error.ACCESS),
        (71, b"\x00", Error.ACCESS),  # no register
        (116, b"\x00\x00", Error.DATA_LENGTH),  # half a register
        (118, b"\x00\x00", Error.DATA_LENGTH),
        (116, b"", Error.DATA_LENGTH),
        (8, b"\x08", Error.DATA_RANGE),
        (11, b"\x05", Error.DATA_RANGE),  # a mode without a current sensor
        (10, b"\x08", Error.DATA_RANGE),
        (168, b"\x07\x00", Error.DATA_RANGE),  # pointers into the EEPROM
        (64, b"\x02", Error.DATA_RANGE),
        (64, b"\x00\x01\x00\x00\x00", Error.ACCESS),  # across a gap
    ],
)
def test_writes_are_refused(address: int, data: bytes, error: Error) -> None:
    line = Line()
    status = line.say(Code.WRITE, address.to_bytes(2, "little") + data)
    assert status == Status(1, error)
    assert line.read("LED") == 0


def test_refused_write_of_several_registers_changes_none() -> None:
    line = Line()
    status = line.say(Code.WRITE, b"\x64\x00" + bytes(4) + (5000).to_bytes(4, "little"))
    assert status == Status(1, Error.ACCESS)
    limits = line.table["Max Position Limit"].encode(3000) + line.table["Min Position Limit"].encode(5000)
    assert line.say(Code.WRITE, b"\x30\x00" + limits) == Status(1, Error.DATA_RANGE)
    assert line.read("Max Position Limit") == 4095


@pytest.mark.parametrize("address", [71, 900])
def test_reading_what_is_not_there_is_an_access_error(address: int) -> None:
    assert Line().say(Code.READ, address.to_bytes(2, "little") + b"\x01\x00") == Status(1, Error.ACCESS)


def test_eeprom_is_locked_under_torque() -> None:
    line = Line()
    line.write("Torque Enable", 1)
    assert line.write("Return Delay Time", 0) == Error.ACCESS
    line.write("Torque Enable", 0)
    assert line.write("Return Delay Time", 0) == 0


def test_unknown_instruction_and_action_without_anything_registered() -> None:
    line = Line()
    assert line.say(0x77) == Status(1, Error.INSTRUCTION)
    assert line.say(Code.ACTION) == Status(1, Error.INSTRUCTION)


def test_damaged_instruction_is_answered_with_a_crc_error() -> None:
    line = Line()
    data = bytearray(encode(Instruction(1, Code.PING)))
    data[-1] ^= 1
    assert [Parser().feed(reply.data) for reply in line.bus.receive(bytes(data))] == [[Status(1, Error.CRC)]]


def test_reboot_keeps_the_eeprom_and_forgets_the_rest() -> None:
    line = Line(boot_s=0.2)
    line.write("Return Delay Time", 7)
    line.write("Profile Velocity", 50)
    line.write("Torque Enable", 1)
    assert line.say(Code.REBOOT) == Status(1)
    assert line.say(Code.PING) is None  # it boots
    line.wait(0.21)
    assert [line.read(n) for n in ("Return Delay Time", "Profile Velocity", "Torque Enable")] == [7, 0, 0]


@pytest.mark.parametrize(("option", "left"), [(0xFF, (1, 1)), (0x01, (9, 1)), (0x02, (9, 3))])
def test_factory_reset_keeps_what_it_is_told(option: int, left: tuple[int, int]) -> None:
    line = Line()
    for name, value in (("ID", 9), ("Baud Rate", 3), ("Homing Offset", 100)):
        line.servo.poke(name, value)
    (reply,) = line.bus.receive(encode(Instruction(9, Code.FACTORY_RESET, bytes((option,)))))
    assert Parser().feed(reply.data) == [Status(9)]
    assert (line.servo["ID"], line.servo["Baud Rate"], line.servo["Homing Offset"]) == (*left, 0)


def test_factory_reset_of_everything_is_not_for_everybody() -> None:
    line = Line()
    line.servo.poke("ID", 9)
    assert line.bus.receive(encode(Instruction(0xFE, Code.FACTORY_RESET, b"\xff"))) == []
    assert line.servo["ID"] == 9


def test_new_id_counts_after_the_answer() -> None:
    line = Line()
    assert line.say(Code.WRITE, b"\x07\x00\x05") == Status(1)
    assert line.say(Code.PING) is None
    assert line.bus.receive(encode(Instruction(5, Code.PING)))


@pytest.mark.parametrize(("level", "answered"), [(0, {Code.PING}), (1, {Code.PING, Code.READ})])
def test_status_return_level(level: int, answered: set[Code]) -> None:
    line = Line()
    line.servo.poke("Status Return Level", level)
    says = {Code.PING: b"", Code.READ: b"\x84\x00\x04\x00", Code.WRITE: b"\x41\x00\x01"}
    assert {code for code, params in says.items() if line.say(code, params)} == answered
    assert line.servo["LED"] == 1


def test_unstuffed_goal_is_ignored_and_the_stuffed_one_obeyed() -> None:
    line = Line()
    line.write("Operating Mode", 4)
    line.write("Torque Enable", 1)
    body = b"\x03\x74\x00" + (-131073).to_bytes(4, "little", signed=True)
    unstuffed = with_crc(b"\xff\xff\xfd\x00\x01" + (len(body) + 2).to_bytes(2, "little") + body)
    assert line.bus.receive(unstuffed) == []
    assert line.write("Goal Position", -131073) == 0
    assert line.read("Goal Position") == -131073
    line.wait(200.0)
    assert line.read("Present Position") == -131073
    assert line.write("Goal Position", -1_048_576) == Error.DATA_LIMIT


def test_clear_takes_turns_off_only_at_rest() -> None:
    line = Line()
    line.write("Operating Mode", 4)
    line.write("Torque Enable", 1)
    line.write("Goal Position", 10_000)
    line.wait(0.2)
    assert line.say(Code.CLEAR, b"\x01\x44\x58\x4c\x22") == Status(1, Error.RESULT_FAIL)
    line.wait(20.0)
    assert line.say(Code.CLEAR, b"\x01\x44\x58\x4c\x22") == Status(1)
    assert line.read("Present Position") == 10_000 % 4096
    assert line.say(Code.CLEAR, b"\x01\x00\x00\x00\x00") == Status(1, Error.DATA_RANGE)


def test_homing_offset_and_reverse_mode_shift_what_is_read() -> None:
    line = Line(position=1000)
    line.write("Homing Offset", 24)
    assert line.read("Present Position") == 1024
    line.write("Homing Offset", 2000)  # too much for position mode
    assert line.read("Present Position") == 1000
    line.write("Homing Offset", 0)
    line.write("Drive Mode", 1)
    assert line.read("Present Position") == 3096
    line.write("Torque Enable", 1)
    line.write("Goal Position", 3196)
    line.wait(5.0)
    assert line.servo.joint_rad_at(line.clock.now_ns()) == pytest.approx(900 * STEP_RAD)


def test_torque_on_makes_the_goal_the_present_position() -> None:
    line = Line()
    line.write("Goal Position", 3000)
    line.wait(1.0)
    assert line.read("Present Position") == 2048
    line.servo.turn_by_hand(100 * STEP_RAD)
    line.write("Torque Enable", 1)
    line.wait(1.0)
    assert (line.read("Goal Position"), line.read("Present Position")) == (2148, 2148)
    line.servo.turn_by_hand(100 * STEP_RAD)
    assert line.read("Present Position") == 2148


def test_watchdog_stops_a_servo_nobody_speaks_to() -> None:
    line = moving_line()
    line.write("Bus Watchdog", 5)
    line.write("Goal Position", 4000)
    line.wait(0.09)
    assert line.read("Bus Watchdog") == 5  # and this was heard
    line.wait(0.3)
    stopped = line.servo.joint_rad_at(line.clock.now_ns())
    assert stopped == line.servo.joint_rad_at(line.clock.now_ns() - round(0.19e9))  # since 0.1 s after the last word
    assert stopped > line.servo.joint_rad_at(line.clock.now_ns() - round(0.22e9))
    assert line.read("Bus Watchdog") == -1
    assert line.write("Goal Position", 4000) == Error.DATA_RANGE
    assert line.write("Bus Watchdog", 5) == Error.DATA_RANGE
    line.wait(1.0)
    assert line.servo.joint_rad_at(line.clock.now_ns()) == stopped
    assert line.write("Bus Watchdog", 0) == 0
    assert line.write("Goal Position", 4000) == 0
    line.wait(5.0)
    assert line.read("Present Position") == 4000


@pytest.mark.parametrize(
    ("register", "value", "bit", "off"),
    [("Present Temperature", 73, 0x04, True), ("Present Input Voltage", 59, 0x01, False)],
)
def test_alerts_stay_until_the_reboot(register: str, value: int, bit: int, off: bool) -> None:
    line = moving_line()
    line.write("Goal Position", 4000)
    line.wait(0.5)
    normal = line.read(register)
    line.servo.poke(register, value)
    line.wait(5.0)
    assert line.write("LED", 1) == ALERT
    assert line.read("Hardware Error Status") == bit
    assert line.read("Torque Enable") == (not off)
    assert (line.read("Present Position") < 4000) is off
    if off:
        assert line.write("Torque Enable", 1) == ALERT
        assert line.read("Torque Enable") == 0
    line.servo.poke(register, normal)
    assert line.write("LED", 0) == ALERT
    line.say(Code.REBOOT)
    line.wait(0.2)
    assert line.write("Torque Enable", 1) == 0


def test_stall_becomes_an_overload_unless_the_effort_is_limited() -> None:
    for pwm, alert in ((885, 0x20), (300, 0)):
        line = moving_line()
        line.servo.mechanical_stops = (0, 2500)
        line.write("Goal PWM", pwm)
        line.write("Goal Position", 4000)
        line.wait(1.5)
        assert line.read("Present Position") == 2500
        assert line.read("Present Load") == pytest.approx(1000 * pwm / 885, abs=1)
        assert line.read("Moving Status") & 0x08
        line.wait(5.0)
        assert line.read("Hardware Error Status") == alert
        assert line.read("Torque Enable") == (not alert)


def test_stuck_and_heavily_loaded_servos_do_not_move() -> None:
    line = moving_line()
    line.servo.stuck = True
    line.write("Goal Position", 2100)  # too near to press hard
    line.wait(3.0)
    assert (line.read("Present Position"), line.read("Hardware Error Status")) == (2048, 0)
    line.servo.stuck = False
    line.wait(3.0)
    assert line.read("Present Position") == 2100
    line.servo.load = 1.0
    line.wait(3.0)
    assert line.read("Hardware Error Status") == 0x20


def test_stuck_in_the_middle_of_a_move() -> None:
    line = moving_line()
    line.write("Goal Position", 4000)
    line.wait(0.5)
    line.servo.stuck = True
    held = line.read("Present Position")
    line.wait(0.5)
    assert (line.read("Present Position"), line.read("Present Velocity")) == (held, 0)


def test_goal_error_is_what_is_left_at_the_end() -> None:
    line = moving_line(goal_error=3)
    line.write("Goal Position", 3000)
    line.wait(5.0)
    assert line.read("Present Position") == 3003


def test_velocity_and_pwm_modes_turn_and_press() -> None:
    line = Line()
    line.write("Operating Mode", 1)
    line.write("Torque Enable", 1)
    line.write("Goal Velocity", -50)
    line.wait(1.0)
    assert line.read("Present Velocity") == -50
    line.write("Torque Enable", 0)
    line.write("Operating Mode", 16)
    line.write("Torque Enable", 1)
    line.servo.mechanical_stops = (-math.inf, 5000)
    line.write("Goal PWM", 200)
    line.wait(60.0)
    assert line.servo.joint_rad_at(line.clock.now_ns()) == pytest.approx(5000 * STEP_RAD)
    assert line.read("Present PWM") == 200
    assert line.read("Hardware Error Status") == 0


def test_current_based_mode_presses_with_the_goal_current() -> None:
    line = Line("XM430-W350")
    line.write("Operating Mode", 5)
    line.write("Torque Enable", 1)
    line.write("Goal Current", 100)
    line.servo.mechanical_stops = (0, 2200)
    line.write("Goal Position", 9000)
    line.wait(10.0)
    assert (line.read("Present Position"), line.read("Present Current")) == (2200, 100)
    assert line.read("Hardware Error Status") == 0


def test_indirect_registers_stand_for_others() -> None:
    line = Line()
    pointers = b"".join(a.to_bytes(2, "little") for a in (65, 116, 117, 118, 119, 132, 133))
    assert line.say(Code.WRITE, b"\xa8\x00" + pointers) == Status(1)
    assert line.say(Code.WRITE, b"\xe0\x00\x01" + (1234).to_bytes(4, "little")) == Status(1)
    assert (line.read("LED"), line.read("Goal Position")) == (1, 1234)
    assert line.say(Code.READ, b"\xe0\x00\x07\x00") == Status(1, 0, b"\x01\xd2\x04\x00\x00\x00\x08")


def test_events_happen_at_their_time_and_place() -> None:
    line = moving_line()
    line.servo.at_position(2500, line.servo.hold_fast)
    line.servo.at_time(round(2.5e9), lambda now_ns: line.servo.hold_fast(now_ns, stuck=False))
    line.write("Goal Position", 2600)
    line.wait(2.0)
    assert line.read("Present Position") == 2500
    line.wait(2.0)
    assert line.read("Present Position") == 2600


@pytest.mark.parametrize("model", MODELS)
def test_every_model_answers_with_its_factory_values(model: str) -> None:
    line = Line(model)
    for name, value in MODELS[model].items():
        if name in line.table:
            assert line.read(name) == value
    status = line.say(Code.PING)
    assert status is not None
    assert int.from_bytes(status.params[:2], "little") == model_number(model)


def test_models_and_speeds_there_are_not() -> None:
    with pytest.raises(RigError, match="no emulated servo of model 'AX-12A'"):
        EmulatedServo(1, "AX-12A", clock=SimClock())
    with pytest.raises(RigError, match="9601 baud"):
        EmulatedServo(1, clock=SimClock(), baud=9601)
