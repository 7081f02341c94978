"""The emulated servos' codec against anything a line may bring."""

from __future__ import annotations

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.sim.dynamixel.packets import (
    BROADCAST,
    LONGEST,
    BadCrc,
    Code,
    Instruction,
    Parser,
    Status,
    encode,
    stuff,
    unstuff,
    with_crc,
)

NASTY = st.lists(
    st.sampled_from([b"\xff", b"\xfd", b"\x00", b"\xff\xff\xfd", b"\xff\xff\xfd\xfd", b"\xff\xff\xfd\x00", b"\x01\x03"])
    | st.binary(max_size=4),
    max_size=30,
).map(b"".join)
IDS = st.integers(0, 252) | st.just(BROADCAST)
INSTRUCTIONS = st.builds(Instruction, IDS, st.sampled_from([c for c in Code if c != Code.STATUS]), NASTY)
STATUSES = st.builds(Status, IDS, st.integers(0, 255), NASTY)
PING = Instruction(1, Code.PING)


@given(NASTY)
def test_stuffing_is_undone_and_leaves_no_header(body: bytes) -> None:
    stuffed = stuff(body)
    assert unstuff(stuffed) == body
    assert b"\xff\xff\xfd\x00" not in stuffed + b"\x00"


@given(st.lists(INSTRUCTIONS | STATUSES, max_size=6), st.integers(1, 40))
def test_packets_are_read_back_whatever_the_pieces(packets: list[Instruction | Status], size: int) -> None:
    data = b"".join(map(encode, packets))
    parser = Parser()
    pieces = [data[i : i + size] for i in range(0, len(data), size)]
    assert [packet for piece in pieces for packet in parser.feed(piece)] == packets


@given(st.lists(st.tuples(NASTY, INSTRUCTIONS), max_size=5))
def test_garbage_before_packets_hides_none(parts: list[tuple[bytes, Instruction]]) -> None:
    found = []
    parser = Parser()
    for garbage, packet in parts:
        found += [p for p in parser.feed(garbage + encode(packet)) if not isinstance(p, BadCrc)]
    assert found == [packet for _, packet in parts]


@given(INSTRUCTIONS, st.data())
def test_cut_packet_hides_not_the_next(packet: Instruction, data: st.DataObject) -> None:
    whole = encode(packet)
    cut = whole[: data.draw(st.integers(0, len(whole) - 1))]
    assert Parser().feed(cut + encode(PING))[-1] == PING


@pytest.mark.parametrize("alphabet", [bytes(range(256)), b"\xff\xfd\x00", b"\xff\xff\xff\xfd\x00\x01\x03\x04\x55"])
def test_parser_survives_a_hundred_thousand_random_bytes(alphabet: bytes) -> None:
    noise = bytes(random.Random(1).choices(alphabet, k=100_000))
    parser = Parser()
    for start in range(0, len(noise), 97):
        parser.feed(noise[start : start + 97])
    assert parser.feed(encode(PING))[-1] == PING


@given(st.binary(min_size=1, max_size=3), st.integers(7, 15), st.integers(0, 7))
def test_damage_is_noticed(params: bytes, index: int, bit: int) -> None:
    data = bytearray(encode(Instruction(1, Code.WRITE, b"\x74\x00" + params)))
    data[index % (len(data) - 7) + 7] ^= 1 << bit
    assert Instruction not in {type(packet) for packet in Parser().feed(bytes(data))}


def test_goal_that_looks_like_a_header_is_stuffed() -> None:
    goal = (-131073).to_bytes(4, "little", signed=True)
    assert goal == b"\xff\xff\xfd\xff"
    packet = Instruction(1, Code.WRITE, b"\x74\x00" + goal)
    assert b"\xff\xff\xfd\xfd\xff" in encode(packet)
    assert Parser().feed(encode(packet)) == [packet]


def test_header_within_a_packet_ends_it() -> None:
    body = b"\x03\x74\x00\xff\xff\xfd\xff"
    unstuffed = with_crc(b"\xff\xff\xfd\x00\x01" + (len(body) + 2).to_bytes(2, "little") + body)
    assert Parser().feed(unstuffed + encode(PING)) == [PING]


def test_what_cannot_be_sent_is_refused() -> None:
    with pytest.raises(ValueError, match="id 253"):
        encode(Instruction(253, Code.PING))
    with pytest.raises(ValueError, match="too long"):
        encode(Instruction(1, Code.WRITE, bytes(LONGEST)))
