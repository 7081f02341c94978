"""Several emulated servos on one line, and what is made to go wrong there."""

from __future__ import annotations

import pytest

from viewsep.errors import RigError
from viewsep.sim.clock import SimClock
from viewsep.sim.dynamixel.bus import EmulatedBus
from viewsep.sim.dynamixel.faults import Fault, Kind
from viewsep.sim.dynamixel.packets import BROADCAST, BadCrc, Code, Instruction, Parser, Status, encode
from viewsep.sim.dynamixel.presets import PRESETS, emulated_bus
from viewsep.sim.dynamixel.servo import EmulatedServo

POSITION = b"\x84\x00\x04\x00"
AT_2048 = bytes.fromhex("00080000")


@pytest.fixture
def clock() -> SimClock:
    return SimClock()


@pytest.fixture
def bus(clock: SimClock) -> EmulatedBus:
    return emulated_bus("wrist", clock)


def ask(bus: EmulatedBus, packet: Instruction, baud: int | None = None) -> list[object]:
    return [found for reply in bus.receive(encode(packet), baud) for found in Parser().feed(reply.data)]


def ping(servo_id: int = 1) -> Instruction:
    return Instruction(servo_id, Code.PING)


def read(servo_id: int = 1) -> Instruction:
    return Instruction(servo_id, Code.READ, POSITION)


def test_ping_to_all_is_answered_in_turn(bus: EmulatedBus) -> None:
    replies = bus.receive(encode(ping(BROADCAST)))
    assert [Parser().feed(reply.data)[0].id for reply in replies] == [1, 2, 3]
    assert replies[0].delay_s < replies[1].delay_s < replies[2].delay_s


def test_told_to_all_everybody_obeys_and_nobody_answers(bus: EmulatedBus) -> None:
    assert ask(bus, Instruction(BROADCAST, Code.WRITE, b"\x41\x00\x01")) == []
    assert ask(bus, Instruction(BROADCAST, Code.READ, POSITION)) == []
    assert [servo["LED"] for servo in bus.servos] == [1, 1, 1]


def test_group_reads_come_in_the_order_asked_for(bus: EmulatedBus) -> None:
    assert ask(bus, Instruction(BROADCAST, Code.SYNC_READ, POSITION + b"\x03\x01")) == [
        Status(3, 0, AT_2048),
        Status(1, 0, AT_2048),
    ]


@pytest.mark.parametrize("code", [Code.SYNC_READ, Code.FAST_SYNC_READ])
def test_behind_a_silent_servo_nobody_answers(bus: EmulatedBus, code: Code) -> None:
    whole = bus.receive(encode(Instruction(BROADCAST, code, POSITION + b"\x01\x02\x03")))
    bus[2].silent = True
    left = bus.receive(encode(Instruction(BROADCAST, code, POSITION + b"\x01\x02\x03")))
    assert len(b"".join(reply.data for reply in left)) < len(b"".join(reply.data for reply in whole)) / 1.5
    assert ask(bus, read(3)) == [Status(3, 0, AT_2048)]


def test_alert_of_one_servo_shows_in_its_part_only(bus: EmulatedBus) -> None:
    bus[2].overload()
    answers = ask(bus, Instruction(BROADCAST, Code.SYNC_READ, POSITION + b"\x01\x02\x03"))
    assert [status.error for status in answers if isinstance(status, Status)] == [0, 0x80, 0]


def test_registered_writes_begin_together(bus: EmulatedBus, clock: SimClock) -> None:
    for servo_id in (1, 2, 3):
        ask(bus, Instruction(servo_id, Code.WRITE, b"\x40\x00\x01"))
        ask(bus, Instruction(servo_id, Code.REG_WRITE, b"\x74\x00" + (3000).to_bytes(4, "little")))
    clock.sleep_until(10**9)
    assert [servo.counts for servo in bus.servos] == [2048] * 3
    assert ask(bus, Instruction(BROADCAST, Code.ACTION)) == []
    clock.sleep_until(5 * 10**9)
    assert [servo.counts for servo in bus.servos] == [3000] * 3


def test_second_id_obeys_without_a_word(bus: EmulatedBus) -> None:
    bus[1].poke("Secondary(Shadow) ID", 30)
    assert ask(bus, Instruction(30, Code.WRITE, b"\x41\x00\x01")) == []
    assert bus[1]["LED"] == 1


@pytest.mark.parametrize("code", [Code.SYNC_WRITE, Code.BULK_WRITE, Code.SYNC_READ, Code.FAST_BULK_READ])
@pytest.mark.parametrize("size", range(8))
def test_group_instructions_that_break_off_do_no_harm(bus: EmulatedBus, code: Code, size: int) -> None:
    ask(bus, Instruction(BROADCAST, code, bytes(range(1, size + 1))))
    assert ask(bus, read()) == [Status(1, 0, AT_2048)]


def test_servos_of_another_baud_rate_hear_noise(clock: SimClock) -> None:
    bus = EmulatedBus([EmulatedServo(1, clock=clock), EmulatedServo(2, clock=clock, baud=1_000_000)])
    assert [len(ask(bus, ping(BROADCAST), baud)) for baud in (57600, 1_000_000, 115200, None)] == [1, 1, 0, 2]
    assert ask(bus, Instruction(1, Code.WRITE, b"\x08\x00\x03"), 57600) == [Status(1)]
    assert [len(ask(bus, ping(), baud)) for baud in (57600, 1_000_000)] == [0, 1]


def test_return_delay_time(bus: EmulatedBus) -> None:
    assert bus.receive(encode(ping()))[0].delay_s == pytest.approx(500e-6)
    ask(bus, Instruction(1, Code.WRITE, b"\x09\x00\x00"))
    assert bus.receive(encode(ping()))[0].delay_s == 0.0


def test_two_servos_of_one_id_are_refused(clock: SimClock) -> None:
    with pytest.raises(RigError, match="same id"):
        EmulatedBus([EmulatedServo(1, clock=clock), EmulatedServo(1, clock=clock)])


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_are_as_from_the_factory(preset: str, clock: SimClock) -> None:
    for servo in emulated_bus(preset, clock).servos:
        assert (servo.model, servo.baud, servo.counts) == ("XL430-W250", 57600, 2048)


SPOILT = {
    Kind.LOST: b"",
    Kind.SHORT_DATA: encode(Status(1, 0, AT_2048[:-1])),
    Kind.NO_DATA: encode(Status(1)),
    Kind.WRONG_ID: encode(Status(2, 0, AT_2048)),
}


@pytest.mark.parametrize("kind", SPOILT)
def test_spoilt_reply_is_the_one_asked_for_only(bus: EmulatedBus, kind: Kind) -> None:
    bus.faults.add(Fault(kind, servo_id=1, nth=2))
    replies = [b"".join(reply.data for reply in bus.receive(encode(read(i)))) for i in (1, 2, 1, 1)]
    good = encode(Status(1, 0, AT_2048))
    assert replies == [good, encode(Status(2, 0, AT_2048)), SPOILT[kind], good]


@pytest.mark.parametrize(("kind", "found"), [(Kind.CORRUPT, {Status, BadCrc}), (Kind.TRUNCATED, {Status})])
def test_damaged_replies_never_pass_for_good_ones(bus: EmulatedBus, kind: Kind, found: set[type]) -> None:
    bus.faults.add(Fault(kind))
    good = encode(Status(1, 0, AT_2048))
    for _ in range(50):
        (reply,) = bus.receive(encode(read()))
        assert reply.data != good
        assert {type(packet) for packet in Parser().feed(reply.data)} <= found - {Status}


def test_late_and_garbled_replies(bus: EmulatedBus) -> None:
    bus.faults.add(Fault(Kind.LATE, nth=1, delay_s=0.25))
    bus.faults.add(Fault(Kind.GARBAGE, nth=2))
    assert bus.receive(encode(read()))[0].delay_s == pytest.approx(0.2505)
    (reply,) = bus.receive(encode(read()))
    assert reply.data.endswith(encode(Status(1, 0, AT_2048)))
    assert len(reply.data) > 15
    bus.faults.clear()
    assert ask(bus, read()) == [Status(1, 0, AT_2048)]


def test_chance_is_seeded() -> None:
    def lost(seed: int) -> list[bool]:
        bus = EmulatedBus([EmulatedServo(1, clock=SimClock())], seed=seed)
        bus.faults.add(Fault(Kind.LOST, probability=0.3))
        return [not bus.receive(encode(ping())) for _ in range(200)]

    assert lost(1) == lost(1) != lost(2)
    assert 30 <= sum(lost(1)) <= 90


def test_faults_of_servos_come_in_their_time_and_place(bus: EmulatedBus, clock: SimClock) -> None:
    bus.faults.add(Fault(Kind.OVERLOAD, servo_id=1, at_ns=10**9))
    bus.faults.add(Fault(Kind.STUCK, servo_id=2, at_counts=2500))
    bus.faults.add(Fault(Kind.SILENT, servo_id=3))
    for servo in bus.servos:
        servo.poke("Profile Velocity", 50)
        servo.poke("Torque Enable", 1)
        servo.poke("Goal Position", 4000)
    clock.sleep_until(2 * 10**9)
    assert bus[1]["Hardware Error Status"] == 0x20
    assert bus[1].counts == pytest.approx(2048 + 50 * 0.229 * 4096 / 60, abs=1)
    assert bus[2].counts == 2500
    assert ask(bus, ping(3)) == []
    with pytest.raises(RigError, match="no servo with id 9"):
        bus.faults.add(Fault(Kind.STUCK, servo_id=9))
