"""Requests: what is understood, what is refused, and with which sentence."""

from __future__ import annotations

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.service.names import PUBLISHED, Keys, attachment, encoding, read_attachment
from viewsep.service.requests import (
    MAX_REQUEST_BYTES,
    REQUESTS,
    Code,
    MoveRequest,
    Refused,
    StartRequest,
    accepted,
    parse_request,
    refused,
)

JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4),
    max_leaves=10,
)
FIELDS = sorted({field for kind in REQUESTS.values() for field in kind.model_fields})


def sent(**fields: object) -> bytes:
    return json.dumps({"owner": "me", **fields}).encode()


def refusal_of(command: str, payload: bytes) -> Refused | None:
    try:
        parse_request(command, payload)
    except Refused as error:
        return error
    return None


def test_a_request_carries_what_was_sent() -> None:
    start = parse_request("start", sent(candidates=["tea", "decaf"], seed=7, token="abc"))
    assert start == StartRequest(owner="me", token="abc", candidates=("tea", "decaf"), seed=7)
    known = parse_request("start", sent(pose_tolerance_deg=4.5))
    assert known == StartRequest(owner="me", pose_tolerance_deg=4.5)
    move = parse_request("move", sent(joints_deg=[10, -20.5]))
    assert move == MoveRequest(owner="me", joints_deg=(10.0, -20.5))


@pytest.mark.parametrize("command", REQUESTS)
def test_every_command_says_whose_request_it_is(command: str) -> None:
    with pytest.raises(Refused, match="field 'owner' is missing") as refusal:
        parse_request(command, b"{}")
    assert refusal.value.code is Code.BAD_REQUEST


@pytest.mark.parametrize(
    ("command", "payload", "code", "says"),
    [
        ("fly", sent(), Code.UNKNOWN_COMMAND, "no command 'fly': use one of start, cancel"),
        ("start", b"", Code.BAD_JSON, "not JSON"),
        ("start", b"\xff\xfe", Code.BAD_JSON, "not JSON"),
        ("start", b"[" * 50_000, Code.BAD_JSON, "not JSON"),
        ("start", b"[1]", Code.BAD_JSON, "must be a JSON object, not list"),
        ("start", b" " * (MAX_REQUEST_BYTES + 1), Code.TOO_LARGE, "at most 65536"),
        ("start", sent(sed=3), Code.BAD_REQUEST, "unknown field 'sed': known are owner, token, candidates, seed"),
        ("start", sent(pose_tolerance_deg=0.0), Code.BAD_REQUEST, "field 'pose_tolerance_deg' = 0.0"),
        ("start", sent(seed="3"), Code.BAD_REQUEST, "field 'seed' = '3'"),
        ("start", sent(seed=True), Code.BAD_REQUEST, "field 'seed' = True"),
        ("start", sent(seed=2**62 + 1), Code.BAD_REQUEST, "field 'seed' = 4611686018427387905"),
        ("start", sent(candidates=["x"] * 1001), Code.BAD_REQUEST, "field 'candidates'"),
        ("start", sent(token="a/b"), Code.BAD_REQUEST, "field 'token' = 'a/b'"),
        ("start", sent(owner=""), Code.BAD_REQUEST, "field 'owner' = ''"),
        ("move", sent(), Code.BAD_REQUEST, "give joints_deg or view_deg"),
        ("move", sent(joints_deg=[1], view_deg=[1, 2]), Code.BAD_REQUEST, "give joints_deg or view_deg"),
        ("move", sent(joints_deg=[float("nan")]), Code.BAD_REQUEST, "field 'joints_deg.0' = nan"),
        ("move", sent(view_deg=[1]), Code.BAD_REQUEST, "field 'view_deg.1' is missing"),
        ("record", sent(enabled=1), Code.BAD_REQUEST, "field 'enabled' = 1"),
        ("learn", sent(source="tea", views=3), Code.BAD_REQUEST, "field 'views' = 3"),
    ],
)
def test_what_cannot_be_read_is_refused_with_a_sentence(command: str, payload: bytes, code: Code, says: str) -> None:
    with pytest.raises(Refused) as refusal:
        parse_request(command, payload)
    assert refusal.value.code is code
    assert says in str(refusal.value)
    assert len(str(refusal.value)) < 400


@given(st.sampled_from(sorted(REQUESTS)), st.binary(max_size=200))
def test_no_bytes_whatever_do_anything_but_parse_or_be_refused(command: str, payload: bytes) -> None:
    refusal = refusal_of(command, payload)
    assert refusal is None or json.loads(refused(command, refusal))["accepted"] is False


@given(st.sampled_from(sorted(REQUESTS)), st.dictionaries(st.sampled_from(FIELDS), JSON_VALUES))
def test_no_json_whatever_does_anything_but_parse_or_be_refused(command: str, table: dict[str, object]) -> None:
    refusal = refusal_of(command, json.dumps(table).encode())
    assert refusal is None or (refusal.code is Code.BAD_REQUEST and str(refusal).startswith(command))


def test_replies_are_json() -> None:
    assert json.loads(accepted("start", task="bench-1")) == {"accepted": True, "command": "start", "task": "bench-1"}
    assert json.loads(refused("start", Refused(Code.BUSY, "wait"))) == {
        "accepted": False,
        "command": "start",
        "code": "busy",
        "message": "wait",
    }


def test_keys_are_those_of_the_design() -> None:
    keys = Keys("bench")
    assert keys.status == "viewsep/bench/status"
    assert keys.command("start") == "viewsep/bench/cmd/start"
    assert keys.image == "viewsep/bench/camera/image"
    assert keys.alive("rig") == "viewsep/bench/alive/rig"
    assert encoding("percept") == "application/protobuf;viewsep.Percept"
    assert encoding("camera/image") == "application/protobuf;foxglove.CompressedImage"
    assert encoding("log") == "application/protobuf;foxglove.Log"
    assert set(PUBLISHED) >= {"camera/image", "motion/state", "percept", "estimate", "command", "result", "log"}


@given(st.integers(0, 2**64 - 1), st.integers(-(2**63), 2**63 - 1))
def test_an_attachment_is_read_as_it_was_written(sequence: int, stamp_ns: int) -> None:
    assert read_attachment(attachment(sequence, stamp_ns)) == (sequence, stamp_ns)


@given(st.binary(max_size=40).filter(lambda data: len(data) != 16))
def test_other_bytes_are_no_attachment(data: bytes) -> None:
    with pytest.raises(ValueError, match="no attachment"):
        read_attachment(data)
