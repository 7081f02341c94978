"""Emulated servos behind a pseudo-terminal, asked by clients that others wrote."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import dynamixel_easy_sdk as easy
import dynamixel_sdk as sdk
import pytest
import rustypot
import serial

from viewsep.clock import MonotonicClock
from viewsep.errors import RigError
from viewsep.sim.dynamixel.bus import EmulatedBus
from viewsep.sim.dynamixel.faults import Fault, Kind
from viewsep.sim.dynamixel.packets import Code, Instruction, Parser, Status, encode
from viewsep.sim.dynamixel.port import EmulatedPort
from viewsep.sim.dynamixel.presets import emulated_bus

DEADLINE_S = 10.0
OK = (0, 0)


@pytest.fixture
def bus() -> EmulatedBus:
    bus = emulated_bus("wrist", MonotonicClock())
    for servo in bus.servos:
        servo.poke("Return Delay Time", 0)
    return bus


@pytest.fixture
def port(bus: EmulatedBus) -> Iterator[EmulatedPort]:
    with EmulatedPort(bus) as port:
        yield port


@pytest.fixture
def handler(port: EmulatedPort) -> Iterator[Any]:
    handler = sdk.PortHandler(port.name)
    assert handler.setBaudRate(57600)
    yield handler
    handler.closePort()


def until(condition: Callable[[], bool]) -> None:
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end_s, "it did not happen in time"
        time.sleep(0.005)


class TestSdk:
    """dynamixel_sdk, ROBOTIS' own."""

    packets = sdk.PacketHandler(2.0)

    def test_finds_servos(self, handler: Any) -> None:
        assert self.packets.ping(handler, 2) == (1060, *OK)
        found, result = self.packets.broadcastPing(handler)
        assert (found, result) == ({1: [1060, 47], 2: [1060, 47], 3: [1060, 47]}, 0)

    def test_moves(self, handler: Any) -> None:
        assert self.packets.write1ByteTxRx(handler, 1, 64, 1) == OK
        assert self.packets.write4ByteTxRx(handler, 1, 116, 2300) == OK
        until(lambda: self.packets.read4ByteTxRx(handler, 1, 132) == (2300, *OK))

    def test_is_told_of_errors(self, handler: Any) -> None:
        assert self.packets.write4ByteTxRx(handler, 1, 116, 5000) == (0, sdk.ERRNUM_DATA_LIMIT)
        assert self.packets.write4ByteTxRx(handler, 1, 132, 5000) == (0, sdk.ERRNUM_ACCESS)

    def test_registers_reboots_and_resets(self, handler: Any) -> None:
        assert self.packets.regWriteTxRx(handler, 1, 65, 1, [1]) == OK
        assert self.packets.action(handler, 1) == 0
        until(lambda: bool(handler.getBytesAvailable() == 11))  # the answer, which the SDK leaves on the line
        handler.clearPort()
        assert self.packets.read1ByteTxRx(handler, 1, 65) == (1, *OK)
        assert self.packets.reboot(handler, 1) == OK
        until(lambda: self.packets.ping(handler, 1)[1] == 0)
        assert self.packets.read1ByteTxRx(handler, 1, 65) == (0, *OK)
        assert self.packets.clearMultiTurn(handler, 1) == OK
        assert self.packets.factoryReset(handler, 1, 0x02) == OK
        until(lambda: self.packets.ping(handler, 1)[1] == 0)
        assert self.packets.read1ByteTxRx(handler, 1, 9) == (250, *OK)

    @pytest.mark.parametrize("read", ["txRxPacket", "fastSyncRead"])
    def test_reads_and_writes_in_sync(self, handler: Any, read: str) -> None:
        writer, reader = (
            sdk.GroupSyncWrite(handler, self.packets, 116, 4),
            sdk.GroupSyncRead(handler, self.packets, 116, 4),
        )
        for servo_id in (1, 2, 3):
            assert writer.addParam(servo_id, (2000 + servo_id).to_bytes(4, "little"))
            assert reader.addParam(servo_id)
        assert writer.txPacket() == 0
        assert getattr(reader, read)() == 0
        assert [reader.getData(servo_id, 116, 4) for servo_id in (1, 2, 3)] == [2001, 2002, 2003]

    @pytest.mark.parametrize("read", ["txRxPacket", "fastBulkRead"])
    def test_reads_and_writes_in_bulk(self, handler: Any, read: str) -> None:
        writer, reader = sdk.GroupBulkWrite(handler, self.packets), sdk.GroupBulkRead(handler, self.packets)
        assert writer.addParam(1, 65, 1, [1])
        assert writer.addParam(2, 112, 4, (77).to_bytes(4, "little"))
        assert reader.addParam(1, 65, 1)
        assert reader.addParam(2, 112, 4)
        assert writer.txPacket() == 0
        assert getattr(reader, read)() == 0
        assert (reader.getData(1, 65, 1), reader.getData(2, 112, 4)) == (1, 77)

    def test_baud_rate_counts(self, handler: Any) -> None:
        handler.setBaudRate(1_000_000)
        assert self.packets.ping(handler, 1)[1] == sdk.COMM_RX_TIMEOUT
        handler.setBaudRate(57600)
        assert self.packets.write1ByteTxRx(handler, 1, 8, 3) == OK
        assert self.packets.ping(handler, 1)[1] == sdk.COMM_RX_TIMEOUT
        handler.setBaudRate(1_000_000)
        assert self.packets.ping(handler, 1) == (1060, *OK)


def test_easy_sdk_moves(port: EmulatedPort) -> None:
    connector = easy.Connector(port.name, 57600)
    try:
        motors = [connector.createMotor(servo_id) for servo_id in (1, 2)]
        for motor in motors:
            motor.enableTorque()
            motor.setGoalPosition(2100)
            until(partial(lambda motor: motor.getPresentPosition() == 2100, motor))
            motor.disableTorque()
            motor.setOperatingMode(easy.OperatingMode.EXTENDED_POSITION)
            assert motor.getOperatingMode() == easy.OperatingMode.EXTENDED_POSITION
    finally:
        connector.closePort()


@pytest.mark.parametrize("fast", [False, True])
def test_rustypot_moves(port: EmulatedPort, fast: bool) -> None:
    controller = rustypot.Xl430PyController(port.name, 57600, 0.5)
    try:
        assert controller.scan([1, 2, 3, 4]) == {1: 1060, 2: 1060, 3: 1060}
        controller.set_fast_sync_read(fast)
        controller.sync_write_torque_enable([1, 2, 3], [True, True, True])
        controller.sync_write_goal_position([1, 2, 3], [2200, 1900, 2100])
        until(lambda: bool(controller.sync_read_present_position([1, 2, 3]) == [2200, 1900, 2100]))
        assert controller.read_register_with_error(1, "present_temperature")[1] == 0
        with pytest.raises(RuntimeError, match="timed out"):
            controller.read_present_position(9)
    finally:
        controller.close()


def raw(port: EmulatedPort) -> serial.Serial:
    return serial.Serial(port.name, 57600, timeout=1.0)


def ping(line: serial.Serial) -> list[object]:
    line.write(encode(Instruction(1, Code.PING)))
    return list(Parser().feed(line.read(14)))


def test_unplugging_hangs_up_and_the_link_leads_to_the_next_terminal(bus: EmulatedBus, tmp_path: Path) -> None:
    with EmulatedPort(bus, link=tmp_path / "servos") as port:
        line = raw(port)
        assert len(ping(line)) == 1
        port.unplug()
        assert not Path(port.name).exists()
        with pytest.raises((OSError, serial.SerialException)):
            ping(line)
        line.close()
        port.plug()
        with raw(port) as line:
            assert len(ping(line)) == 1
    assert not (tmp_path / "servos").is_symlink()


def test_scripted_unplugging_happens_though_nobody_speaks(bus: EmulatedBus, port: EmulatedPort) -> None:
    line = os.open(port.name, os.O_RDWR | os.O_NOCTTY)
    bus.faults.add(Fault(Kind.UNPLUG, at_ns=bus.clock.now_ns() + round(0.05e9)))
    until(lambda: not port.plugged)
    assert select.select([line], [], [], DEADLINE_S)[0]
    assert os.read(line, 1) == b""
    with pytest.raises(OSError, match="Input/output error"):
        os.write(line, b"x")
    os.close(line)


def test_servos_stay_powered_while_unplugged(bus: EmulatedBus, port: EmulatedPort) -> None:
    bus[1].poke("LED", 1)
    port.unplug()
    port.unplug()
    port.plug()
    with raw(port) as line:
        line.write(encode(Instruction(1, Code.READ, b"\x41\x00\x01\x00")))
        assert Parser().feed(line.read(12)) == [Status(1, 0, b"\x01")]


def test_speed_without_a_constant(bus: EmulatedBus, port: EmulatedPort) -> None:
    bus[1].poke("Baud Rate", 7)
    with raw(port) as line:
        line.baudrate = 4_500_000
        assert len(ping(line)) == 1


def test_late_reply_comes_after_the_next_question(bus: EmulatedBus, port: EmulatedPort) -> None:
    bus.faults.add(Fault(Kind.LATE, nth=1, delay_s=0.2))
    with raw(port) as line:
        line.write(encode(Instruction(1, Code.READ, b"\x41\x00\x01\x00")))
        line.write(encode(Instruction(2, Code.PING)))
        packets = Parser().feed(line.read(14 + 12))
    assert packets == [Status(2, 0, bytes.fromhex("24042f")), Status(1, 0, b"\x00")]


def test_name_that_is_taken_is_refused(bus: EmulatedBus, tmp_path: Path) -> None:
    taken = tmp_path / "notes"
    taken.write_text("mine")
    with pytest.raises(RigError, match="exists and is not a link"):
        EmulatedPort(bus, link=taken)
    assert taken.read_text() == "mine"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_command_serves_until_it_is_ended(number: signal.Signals, tmp_path: Path) -> None:
    link = tmp_path / "servos"
    command = [sys.executable, "-m", "viewsep", "rig", "emulate", "--preset", "pan_tilt", "--json", "--link", str(link)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        printed = json.loads(process.stdout.readline())
        model = {"model": "XL430-W250", "firmware": 47, "baud": 57600}
        assert printed == {"port": str(link), "servos": [{"id": 1, **model}, {"id": 2, **model}]}
        with serial.Serial(printed["port"], 57600, timeout=1.0) as line:
            assert len(ping(line)) == 1
        process.send_signal(number)
        assert process.wait(DEADLINE_S) == 0
    assert not link.is_symlink()
