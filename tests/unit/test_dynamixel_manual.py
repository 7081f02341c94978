"""The worked examples of ROBOTIS' e-manual, chapter Protocol 2.0, byte for byte, in both directions.

Two instructions are printed with a wrong CRC, and computed here: Control Table Backup's restoring (92 F5, right: 9E F5)
and Fast Bulk Read (20 F2, which is the one of Fast Sync Read above it).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest

from viewsep.sim.clock import SimClock
from viewsep.sim.dynamixel.bus import EmulatedBus
from viewsep.sim.dynamixel.packets import BROADCAST, Code, Instruction, Parser, Status, crc16, encode
from viewsep.sim.dynamixel.servo import EmulatedServo

OK = "FF FF FD 00 01 04 00 55 00 A1 0C"
POSITION_166 = "FF FF FD 00 01 08 00 55 00 A6 00 00 00 8C C0"


@dataclass(frozen=True)
class Example:
    name: str
    sent: str
    instruction: Instruction
    answers: tuple[str, ...] = ()
    statuses: tuple[Status, ...] = ()
    servos: dict[int, dict[str, int]] = field(default_factory=lambda: {1: {}})
    model: str = "XM430-W210"
    before: str = ""
    after: dict[int, dict[str, int]] = field(default_factory=dict)


PING_STATUS = bytes((0x06, 0x04, 0x26))
EXAMPLES = [
    Example(
        "ping",
        "FF FF FD 00 01 03 00 01 19 4E",
        Instruction(1, Code.PING),
        ("FF FF FD 00 01 07 00 55 00 06 04 26 65 5D",),
        (Status(1, 0, PING_STATUS),),
    ),
    Example(
        "ping to all",
        "FF FF FD 00 FE 03 00 01 31 42",
        Instruction(BROADCAST, Code.PING),
        ("FF FF FD 00 01 07 00 55 00 06 04 26 65 5D", "FF FF FD 00 02 07 00 55 00 06 04 26 6F 6D"),
        (Status(1, 0, PING_STATUS), Status(2, 0, PING_STATUS)),
        {2: {}, 1: {}},
    ),
    Example(
        "read",
        "FF FF FD 00 01 07 00 02 84 00 04 00 1D 15",
        Instruction(1, Code.READ, bytes.fromhex("84000400")),
        (POSITION_166,),
        (Status(1, 0, bytes.fromhex("a6000000")),),
        {1: {"Present Position": 166}},
    ),
    Example(
        "write",
        "FF FF FD 00 01 09 00 03 74 00 00 02 00 00 CA 89",
        Instruction(1, Code.WRITE, bytes.fromhex("740000020000")),
        (OK,),
        (Status(1),),
        after={1: {"Goal Position": 512}},
    ),
    Example(
        "reg write",
        "FF FF FD 00 01 09 00 04 68 00 C8 00 00 00 AE 8E",
        Instruction(1, Code.REG_WRITE, bytes.fromhex("6800c8000000")),
        (OK,),
        (Status(1),),
        after={1: {"Registered Instruction": 1, "Goal Velocity": 0}},
    ),
    Example(
        "action",
        "FF FF FD 00 01 03 00 05 02 CE",
        Instruction(1, Code.ACTION),
        (OK,),
        (Status(1),),
        before="FF FF FD 00 01 09 00 04 68 00 C8 00 00 00 AE 8E",
        after={1: {"Registered Instruction": 0, "Goal Velocity": 200}},
    ),
    Example(
        "factory reset",
        "FF FF FD 00 01 04 00 06 01 A1 E6",
        Instruction(1, Code.FACTORY_RESET, b"\x01"),
        (OK,),
        (Status(1),),
        {1: {"Return Delay Time": 0}},
        after={1: {"Return Delay Time": 250}},
    ),
    Example("reboot", "FF FF FD 00 01 03 00 08 2F 4E", Instruction(1, Code.REBOOT), (OK,), (Status(1),)),
    Example(
        "clear",
        "FF FF FD 00 01 08 00 10 01 44 58 4C 22 B1 DC",
        Instruction(1, Code.CLEAR, b"\x01\x44\x58\x4c\x22"),
        (OK,),
        (Status(1),),
        {1: {"Operating Mode": 4, "Present Position": 2 * 4096 + 5}},
        after={1: {"Present Position": 5}},
    ),
    Example(
        "control table backup",
        "FF FF FD 00 01 08 00 20 01 43 54 52 4C 16 F5",
        Instruction(1, Code.CONTROL_TABLE_BACKUP, b"\x01CTRL"),
        (OK,),
        (Status(1),),
        model="XC330-T288",
    ),
    Example(
        "control table restore",
        "FF FF FD 00 01 08 00 20 02 43 54 52 4C {crc}",
        Instruction(1, Code.CONTROL_TABLE_BACKUP, b"\x02CTRL"),
        (OK,),
        (Status(1),),
        before="FF FF FD 00 01 08 00 20 01 43 54 52 4C 16 F5",
        model="XC330-T288",
    ),
    Example(
        "sync read",
        "FF FF FD 00 FE 09 00 82 84 00 04 00 01 02 CE FA",
        Instruction(BROADCAST, Code.SYNC_READ, bytes.fromhex("840004000102")),
        (POSITION_166, "FF FF FD 00 02 08 00 55 00 1F 08 00 00 BA BE"),
        (Status(1, 0, bytes.fromhex("a6000000")), Status(2, 0, bytes.fromhex("1f080000"))),
        {1: {"Present Position": 166}, 2: {"Present Position": 2079}},
    ),
    Example(
        "sync write",
        "FF FF FD 00 FE 11 00 83 74 00 04 00 01 96 00 00 00 02 AA 00 00 00 82 87",
        Instruction(BROADCAST, Code.SYNC_WRITE, bytes.fromhex("74000400019600000002aa000000")),
        servos={1: {}, 2: {}},
        after={1: {"Goal Position": 150}, 2: {"Goal Position": 170}},
    ),
    Example(
        "bulk read",
        "FF FF FD 00 FE 0D 00 92 01 90 00 02 00 02 92 00 01 00 1A 05",
        Instruction(BROADCAST, Code.BULK_READ, bytes.fromhex("01900002000292000100")),
        ("FF FF FD 00 01 06 00 55 00 77 00 C3 69", "FF FF FD 00 02 05 00 55 00 24 8B A9"),
        (Status(1, 0, b"\x77\x00"), Status(2, 0, b"\x24")),
        {1: {"Present Input Voltage": 119}, 2: {"Present Temperature": 36}},
    ),
    Example(
        "bulk write",
        "FF FF FD 00 FE 10 00 93 01 20 00 02 00 A0 00 02 1F 00 01 00 50 B7 68",
        Instruction(BROADCAST, Code.BULK_WRITE, bytes.fromhex("0120000200a000021f00010050")),
        servos={1: {"Max Voltage Limit": 150}, 2: {"Temperature Limit": 70}},
        after={1: {"Max Voltage Limit": 160}, 2: {"Temperature Limit": 80}},
    ),
    Example(
        "fast sync read",
        "FF FF FD 00 FE 0A 00 8A 84 00 04 00 03 07 04 20 F2",
        Instruction(BROADCAST, Code.FAST_SYNC_READ, bytes.fromhex("84000400030704")),
        (
            "FF FF FD 00 FE 19 00 55 00 03 A6 00 00 00 84 08"  # each servo's part on a line
            "00 07 1F 08 00 00 16 CA"
            "00 04 FF 03 00 00 D1 9E",
        ),
        servos={3: {"Present Position": 166}, 7: {"Present Position": 2079}, 4: {"Present Position": 1023}},
        model="XC330-T288",
    ),
    Example(
        "fast bulk read",
        "FF FF FD 00 FE 12 00 9A 03 84 00 04 00 07 7C 00 02 00 04 92 00 01 00 {crc}",
        Instruction(BROADCAST, Code.FAST_BULK_READ, bytes.fromhex("0384000400077c0002000492000100")),
        ("FF FF FD 00 FE 14 00 55 00 03 A6 00 00 00 67 A4 00 07 A5 01 24 74 00 04 1F D9 C1",),
        servos={3: {"Present Position": 166}, 7: {"Present PWM": 421}, 4: {"Present Temperature": 31}},
        model="XC330-T288",
    ),
]


def of(text: str) -> bytes:
    """The bytes of an example; the CRC that the manual prints wrong is computed."""
    if "{crc}" in text:
        data = bytes.fromhex(text.replace("{crc}", ""))
        return data + crc16(data).to_bytes(2, "little")
    return bytes.fromhex(text)


def bus_of(example: Example) -> EmulatedBus:
    clock = SimClock()
    servos = [EmulatedServo(i, example.model, clock=clock, firmware=38) for i in example.servos]
    for servo, registers in zip(servos, example.servos.values(), strict=True):
        for name, value in registers.items():
            servo.poke(name, value)
    return EmulatedBus(servos)


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda example: example.name)
class TestExamples:
    def test_bytes_have_the_right_crc(self, example: Example) -> None:
        for text in (example.sent, *example.answers):
            data = of(text)
            assert crc16(data[:-2]) == int.from_bytes(data[-2:], "little")

    def test_instruction_is_encoded_and_parsed(self, example: Example) -> None:
        assert encode(example.instruction) == of(example.sent)
        assert Parser().feed(of(example.sent)) == [example.instruction]

    def test_statuses_are_encoded_and_parsed(self, example: Example) -> None:
        assert [encode(status) for status in example.statuses] == [
            of(t) for t in example.answers[: len(example.statuses)]
        ]
        assert Parser().feed(b"".join(map(encode, example.statuses))) == list(example.statuses)

    def test_emulated_servos_answer_it(self, example: Example) -> None:
        bus = bus_of(example)
        if example.before:
            assert bus.receive(of(example.before))
        assert [reply.data for reply in bus.receive(of(example.sent))] == [of(text) for text in example.answers]
        for servo_id, registers in example.after.items():
            assert {name: bus[servo_id][name] for name in registers} == registers


def test_crcs_that_are_computed_are_printed_wrong() -> None:
    computed = {example.name: of(example.sent)[-2:].hex() for example in EXAMPLES if "{crc}" in example.sent}
    assert computed.keys() == {"control table restore", "fast bulk read"}
    assert computed["control table restore"] == "9ef5"
    assert computed["fast bulk read"] != "20f2"
