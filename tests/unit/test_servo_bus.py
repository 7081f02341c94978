"""The bus driver against what goes wrong on a line: every trap of dynamixel-sdk, on emulated servos."""

from __future__ import annotations

import os
import random
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.clock import MonotonicClock
from viewsep.drivers.dynamixel.bus import Bus, BusStatistics, scan
from viewsep.drivers.dynamixel.control_table import control_table, model_number
from viewsep.drivers.dynamixel.errors import NoReply, PortLost, ServoRefused
from viewsep.drivers.dynamixel.packets import Packets, words
from viewsep.drivers.dynamixel.port import USB_LATENCY_S, usb_latency_s
from viewsep.sim.dynamixel.bus import EmulatedBus
from viewsep.sim.dynamixel.faults import Fault, Kind
from viewsep.sim.dynamixel.packets import Code, Instruction, Status, encode
from viewsep.sim.dynamixel.port import EmulatedPort
from viewsep.sim.dynamixel.servo import EmulatedServo

TABLE = control_table(model_number("XL430-W250"))
POSITION = TABLE["Present Position"]
IDS = (1, 2, 3)


@pytest.fixture
def emulated() -> EmulatedBus:
    """Three servos at 1000, 2000 and 3000 counts."""
    return EmulatedBus([EmulatedServo(i, clock=MonotonicClock(), baud=1_000_000, position=1000 * i) for i in IDS])


@pytest.fixture
def port(emulated: EmulatedBus) -> Iterator[EmulatedPort]:
    with EmulatedPort(emulated) as port:
        yield port


@pytest.fixture
def bus(port: EmulatedPort) -> Iterator[Bus]:
    bus = Bus(port.name, 1_000_000)
    bus.open()
    yield bus
    bus.close()


def positions(bus: Bus) -> dict[int, int]:
    replies = bus.read_what_answers(IDS, POSITION.address, POSITION.size)
    return {servo_id: POSITION.decode(reply.data) for servo_id, reply in replies.items()}


def test_it_finds_every_servo_and_says_at_which_baud(port: EmulatedPort) -> None:
    found = [
        (baud, [(f.servo_id, f.model, f.baud) for f in servos]) for baud, servos in scan(port.name, [57600, 1_000_000])
    ]
    assert found == [(57600, []), (1_000_000, [(i, "XL430-W250", 1_000_000) for i in IDS])]


def test_a_failed_read_is_an_error_and_not_the_value_zero(bus: Bus, emulated: EmulatedBus) -> None:
    emulated.faults.add(Fault(Kind.LOST, servo_id=2))
    with pytest.raises(NoReply, match=r"servo 2 .* does not answer \(4 attempts\): check cable, power, id and baud"):
        bus.read(2, POSITION)
    assert bus.statistics.timeouts == 4
    assert bus.statistics.retries == 3


@pytest.mark.parametrize(
    "kind", [Kind.LOST, Kind.CORRUPT, Kind.TRUNCATED, Kind.WRONG_ID, Kind.GARBAGE, Kind.SHORT_DATA, Kind.NO_DATA]
)
def test_one_spoilt_reply_costs_a_retry_and_no_wrong_value(bus: Bus, emulated: EmulatedBus, kind: Kind) -> None:
    for servo_id in IDS:
        emulated.faults.clear()
        emulated.faults.add(Fault(kind, nth=1))
        assert bus.read(servo_id, POSITION) == 1000 * servo_id
        emulated.faults.clear()
        emulated.faults.add(Fault(kind, nth=2))
        assert positions(bus) == {1: 1000, 2: 2000, 3: 3000}
    spoilt = bus.statistics
    assert spoilt.timeouts + spoilt.damaged + spoilt.strange > 0 or kind is Kind.GARBAGE


@pytest.mark.parametrize("late_s", [0.05, 0.1, 0.13])
def test_a_late_reply_is_not_taken_for_the_next_one(bus: Bus, emulated: EmulatedBus, late_s: float) -> None:
    """It comes when servo 1 stands elsewhere already, and another register was asked for."""
    emulated.faults.add(Fault(Kind.LATE, servo_id=1, nth=1, delay_s=late_s))
    with pytest.raises(NoReply):
        bus.ping(1, retries=0)
    assert bus.read(1, TABLE["Present Temperature"]) == 30
    emulated.faults.clear()
    emulated.faults.add(Fault(Kind.LATE, servo_id=1, nth=1, delay_s=late_s))
    assert set(positions(bus)) == set(IDS)  # asked once more
    emulated[1].poke("Present Position", 1234)
    for _ in range(20):
        assert positions(bus)[1] == 1234
        time.sleep(0.01)


@pytest.mark.alone
def test_a_late_reply_is_known_by_its_length(bus: Bus, emulated: EmulatedBus) -> None:
    """It comes while the answer to the next read of the same block is waited for, and says where the servo was."""
    emulated.faults.add(Fault(Kind.LATE, servo_id=1, nth=1, delay_s=0.1))
    emulated.faults.add(Fault(Kind.LATE, servo_id=1, nth=2, delay_s=0.035))
    moved = threading.Timer(0.06, emulated[1].poke, ("Present Position", 1234))
    moved.start()
    assert positions(bus) == {1: 1234, 2: 2000, 3: 3000}
    assert bus.statistics.strange == 1
    moved.join()


def test_a_silent_servo_does_not_silence_the_others(bus: Bus, emulated: EmulatedBus) -> None:
    emulated[1].silent = True
    assert positions(bus) == {2: 2000, 3: 3000}


def test_the_alert_bit_comes_with_the_reading(bus: Bus, emulated: EmulatedBus) -> None:
    emulated[2].overload()
    replies = bus.read_what_answers(IDS, POSITION.address, POSITION.size)
    assert {servo_id: reply.alert for servo_id, reply in replies.items()} == {1: False, 2: True, 3: False}
    assert bus.read(2, TABLE["Hardware Error Status"]) == 0x20


def test_what_the_servo_refuses_is_told_in_words(bus: Bus) -> None:
    with pytest.raises(ServoRefused, match=r"servo 1 says the value is .*: Goal Position = 5000"):
        bus.write(1, TABLE["Goal Position"], 5000)
    bus.write(1, TABLE["Torque Enable"], 1)
    with pytest.raises(ServoRefused, match=r"servo 1 says the register is locked .*Operating Mode = 4"):
        bus.write(1, TABLE["Operating Mode"], 4)


def test_values_have_signs(bus: Bus, emulated: EmulatedBus) -> None:
    bus.write(3, TABLE["Operating Mode"], 4)
    emulated[3].poke("Present Position", -70_000)
    assert bus.read(3, POSITION) == -70_000


@pytest.mark.parametrize("goal", [-131073, -131072, 0xFDFF, -1])
def test_a_goal_that_looks_like_a_header_arrives(bus: Bus, emulated: EmulatedBus, goal: int) -> None:
    """-131073 is FF FF FD FF on the wire, which must be stuffed."""
    for servo_id in (1, 2):
        bus.write(servo_id, TABLE["Operating Mode"], 4)
    bus.write(1, TABLE["Goal Position"], goal)
    bus.write_all({2: goal}, TABLE["Goal Position"])
    assert bus.read(1, TABLE["Goal Position"]) == bus.read(2, TABLE["Goal Position"]) == goal


@given(
    servo_id=st.integers(0, 252),
    instruction=st.sampled_from([code for code in Code if code != Code.STATUS]),
    parameters=st.lists(st.sampled_from([0xFF, 0xFD, 0x00, 0x55]) | st.integers(0, 255), max_size=60).map(bytes),
)
def test_what_is_sent_is_what_the_other_side_would_send(servo_id: int, instruction: Code, parameters: bytes) -> None:
    """The SDK with our stuffing against the emulated servos' own codec."""
    packet = [0, 0, 0, 0, servo_id, *words(len(parameters) + 3), instruction, *parameters, 0, 0]
    assert Packets().as_sent(packet) == encode(Instruction(servo_id, instruction, parameters))


def test_noise_of_any_kind_is_survived_and_what_comes_after_it_is_understood() -> None:
    """A device that answers every ping with 2000 random bytes, 50 times, and then well."""
    noise = random.Random(0)
    good = encode(Status(1, 0, bytes([0x24, 0x04, 47])))
    master, slave = os.openpty()
    tty.setraw(slave)
    bus = Bus(os.ttyname(slave), 1_000_000, retries=0)
    bus.open()

    def answer(data: bytes) -> None:
        os.read(master, 64)
        os.write(master, data)

    for round_ in range(51):
        data = noise.randbytes(2000) if round_ < 50 else good
        device = threading.Thread(target=answer, args=(data,))
        device.start()
        if round_ < 50:
            with pytest.raises(NoReply):
                bus.ping(1)
        else:
            assert bus.ping(1).model == "XL430-W250"
        device.join()
    assert bus.statistics.bytes_received > 10_000
    bus.close()
    os.close(master)
    os.close(slave)


def test_an_unplugged_port_is_lost_and_can_be_used_again(bus: Bus, emulated: EmulatedBus) -> None:
    with EmulatedPort(emulated) as other:
        bus = Bus(other.name, 1_000_000)
        bus.open()
        assert bus.read(1, POSITION) == 1000
        other.unplug()
        for _ in range(2):
            with pytest.raises(PortLost, match=r"the serial port .* is gone: plug the adapter in again"):
                bus.read(1, POSITION)
        bus.close()
    with EmulatedPort(emulated) as other:
        again = Bus(other.name, 1_000_000)
        again.open()
        assert again.read(1, POSITION) == 1000
        again.close()


def test_an_error_in_the_middle_does_not_leave_the_port_in_use(bus: Bus, emulated: EmulatedBus) -> None:
    """The SDK's guard stays up after an exception; every call says "in use" then."""
    with pytest.raises(OverflowError):
        bus.write(1, TABLE["Goal Position"], 1 << 40)
    assert bus.read(1, POSITION) == 1000


def test_a_port_that_is_not_there_is_named() -> None:
    with pytest.raises(PortLost, match=r"there is no serial port /dev/ttyNOWHERE: check the cable"):
        Bus("/dev/ttyNOWHERE", 57600).open()


def test_a_closed_bus_says_so(port: EmulatedPort) -> None:
    bus = Bus(port.name, 1_000_000)
    with pytest.raises(PortLost, match="is not open"):
        bus.ping(1)
    bus.close()
    bus.close()


def test_two_processes_cannot_have_one_port(bus: Bus, port: EmulatedPort) -> None:
    other = (
        "import sys; from viewsep.drivers.dynamixel.bus import Bus; from viewsep.errors import RigError\n"
        "try: Bus(sys.argv[1], 57600).open()\n"
        "except RigError as error: print(error)"
    )
    told = subprocess.run(
        [sys.executable, "-c", other, port.name], capture_output=True, text=True, timeout=30, check=True
    )
    assert f"the serial port {port.name} is used by process " in told.stdout
    bus.close()
    told = subprocess.run(
        [sys.executable, "-c", other, port.name], capture_output=True, text=True, timeout=30, check=True
    )
    assert told.stdout == ""


def test_any_number_of_threads_may_ask(bus: Bus) -> None:
    wrong: list[object] = []

    def ask(servo_id: int) -> None:
        for _ in range(60):
            try:
                if (counts := bus.read(servo_id, POSITION)) != 1000 * servo_id:
                    wrong.append(counts)
            except Exception as error:
                wrong.append(error)

    threads = [threading.Thread(target=ask, args=(servo_id,)) for servo_id in IDS]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(30.0)
    assert wrong == []


def test_the_wall_clock_has_no_say(bus: Bus, emulated: EmulatedBus, monkeypatch: pytest.MonkeyPatch) -> None:
    """A clock that is set back by an hour at every look would make the SDK's own port wait for ever."""
    walls = iter(range(10**9, 0, -3600))
    monkeypatch.setattr(time, "time", lambda: next(walls))
    emulated.faults.add(Fault(Kind.LOST, servo_id=1))
    with pytest.raises(NoReply):
        bus.read(1, POSITION)


def test_waiting_does_not_spin(bus: Bus, emulated: EmulatedBus) -> None:
    emulated.faults.add(Fault(Kind.LOST))
    began_s, began_cpu_s = time.monotonic(), time.thread_time()
    for _ in range(3):
        with pytest.raises(NoReply):
            bus.read(1, POSITION)
    assert time.thread_time() - began_cpu_s < 0.3 * (time.monotonic() - began_s)


def test_a_dry_run_tells_what_would_be_sent_and_changes_nothing(port: EmulatedPort, emulated: EmulatedBus) -> None:
    told: list[tuple[str, bytes]] = []
    bus = Bus(port.name, 1_000_000, dry_run=True, trace=lambda way, data: told.append((way, data)))
    bus.open()
    bus.write(1, TABLE["Torque Enable"], 1)
    bus.write_all({1: 1500}, TABLE["Goal Position"])
    bus.reboot(1)
    assert [way for way, _ in told] == ["would send"] * 3
    assert told[0][1] == bytes.fromhex("FFFFFD0001060003400001DB66")
    assert emulated[1]["Torque Enable"] == 0
    assert bus.read(1, POSITION) == 1000
    assert [way for way, _ in told[3:]] == [">", "<"]
    bus.close()


def test_it_counts_what_crosses_the_line(bus: Bus) -> None:
    bus.ping(1)
    assert bus.statistics == BusStatistics(instructions=1, bytes_sent=10, bytes_received=14)


def test_a_port_without_a_latency_timer_gets_the_usual_allowance(bus: Bus, port: EmulatedPort) -> None:
    assert usb_latency_s(port.name) is None
    assert USB_LATENCY_S == 0.016
