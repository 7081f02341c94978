"""The commands that talk to a service, against one made of bytes: what they print where, and how they exit."""

from __future__ import annotations

import io
import json
import os
import signal
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
import zenoh
from fake_service import FakeService, Table, accept, fake_service, later, raw, refuse, say, silent, until
from foxglove_schemas_protobuf.Log_pb2 import Log
from ports import free_port
from rich.console import Console
from shell import Ended, Shell

from viewsep.cli import live
from viewsep.messages import CandidateEstimate, Estimate, Outcome, Phase, Result
from viewsep.recordings.codec import to_bytes

ENDED = Result(7, Outcome.IDENTIFIED, "tea", "rated 5 times better", (("tea", 1.0),), np.eye(3), 9, 1.0, 3)
DECAF = CandidateEstimate("decaf", 2.0, 0.9, 0.1, 0.8, np.eye(3), 0.01, True, 50)
BELIEF = Estimate(6, 4, Phase.EXPLORING, (DECAF,), 5, 1.0, None)


@pytest.fixture
def service(monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeService]:
    with fake_service() as served:
        monkeypatch.setenv("VIEWSEP_CONNECT", served.endpoint)
        yield served


def interrupt(service: FakeService, when: str) -> None:
    """Ctrl-C for this process, once somebody listens to a stream."""
    until(lambda: service.watched(when), "nobody listens")
    until(lambda: service.engine["task"] == "t1", "nothing was started")
    os.kill(os.getpid(), signal.SIGINT)


def test_status_as_tables(service: FakeService, shell: Shell) -> None:
    service.motion["fault"] = "pan is hot [31 C]"
    service.end_task("t0", "undecided", None)
    ended = shell("status")
    assert (ended.code, ended.err) == (0, "")
    for words in ("simulated", "generated:7", "standing", "4.0 Hz", "pan is hot [31 C]", "-20.00", "tea", "undecided"):
        assert words in ended.out


def test_status_shows_probabilities_where_there_are_any(service: FakeService, shell: Shell) -> None:
    assert "probability" not in shell("status").out
    service.engine["candidates"][0]["probability"] = 0.625
    service.engine["unknown"] = 0.25
    service.end_task("t0", "identified", "tea", pose_spread_deg=4.2)
    ended = shell("status")
    for words in ("probability", "62.5 %", "none of them", "25.0 %", "Pose known to ±4°."):
        assert words in ended.out
    assert shell("status", "--json").json["engine"]["candidates"][0]["probability"] == 0.625


def test_status_as_json_is_what_the_service_says(service: FakeService, shell: Shell) -> None:
    ended = shell("status", "--json")
    assert ended.code == 0
    assert ended.json == {**service.status, "alive": ["engine", "rig"]}


def test_status_of_one_role_says_that_the_other_is_silent(shell: Shell) -> None:
    with fake_service(roles=("rig",)) as alone:
        ended = shell("status", "--connect", alone.endpoint)
    assert ended.code == 0
    assert "engine" in ended.out
    assert "no answer" in ended.out


def test_status_is_repeated_until_ctrl_c(service: FakeService, shell: Shell) -> None:
    asked: list[Table] = []

    def answer(query: zenoh.Query, table: Table) -> None:
        say(query, service.status)
        asked.append(table)

    service.handlers["status"] = answer

    def interrupt_it() -> None:
        until(lambda: len(asked) > 2, "it is not repeated")
        os.kill(os.getpid(), signal.SIGINT)

    thread = later(interrupt_it)
    ended = shell("status", "--watch", "--json")
    thread.join()
    assert ended.code == 130
    lines = [json.loads(line) for line in ended.out.splitlines()]
    assert len(lines) >= 2
    assert all(line["schema"] == "viewsep.status/1" for line in lines)


def test_rigs_are_listed(service: FakeService, shell: Shell) -> None:
    assert "bench" in shell("rigs").out
    assert shell("rigs", "--json").json == [{"name": "bench", "roles": ["engine", "rig"]}]
    with fake_service(roles=()) as nothing:
        ended = shell("rigs", "--connect", nothing.endpoint)
        assert (ended.code, ended.out) == (1, "")
        assert "no rig is served at" in ended.err
        ended = shell("rigs", "--connect", nothing.endpoint, "--json")
        assert (ended.code, ended.json) == (1, [])


def test_start_prints_the_task_that_goes_on(service: FakeService, shell: Shell) -> None:
    ended = shell("start", "--candidates", "tea,decaf", "--seed", 3, "--owner", "ana")
    assert (ended.code, ended.out, ended.err) == (0, "t1\n", "")
    assert service.requests == [
        ("start", {"owner": "ana", "token": "", "candidates": ["tea", "decaf"], "seed": 3}),
    ]
    assert shell("start", "--json").json == {"accepted": True, "task": "t1"}
    assert shell("start", "--pose-tolerance", "4.5").code == 0
    assert service.requests[-1][1]["pose_tolerance_deg"] == 4.5


UNREACHABLE = {"indistinct": ["tea", "decaf"], "telling_view_deg": [90.0, -85.0], "reason": "no view tells them apart"}


@pytest.mark.parametrize(
    ("outcome", "more", "code", "words"),
    [
        ("identified", {"found": "tea"}, 0, "It is tea: rated 5 times better."),
        ("identified", {"found": "tea", "pose_spread_deg": 4.2}, 0, "9 looks, 123° of travel, pose known to ±4°"),
        ("undecided", {}, 3, "undecided: rated"),
        ("failed", {}, 4, "failed: rated"),
        ("unknown", {}, 6, "It is none of the candidates: rated"),
        (
            "indistinguishable",
            UNREACHABLE,
            7,
            "It is tea or decaf: no view tells them apart; azimuth 90°, elevation -85°",
        ),
        ("of_the_future", {}, 1, "update viewsep"),
    ],
)
def test_start_and_wait_exits_as_the_task_ends(
    service: FakeService, shell: Shell, outcome: str, more: Table, code: int, words: str
) -> None:
    def start(query: zenoh.Query, request: Table) -> None:
        service.engine["task"] = "t1"
        accept(query, task="t1")
        service.end_task("t1", outcome, **{"found": None, **more})

    service.handlers["cmd/start"] = start
    ended = shell("start", "--wait")
    assert ended.code == code
    assert words in ended.out + ended.err
    assert service.requests[0][1]["token"]
    assert shell("start", "--wait", "--json").json["outcome"] == outcome


def test_ctrl_c_cancels_a_task_of_ones_own(service: FakeService, shell: Shell) -> None:
    def cancel(query: zenoh.Query, request: Table) -> None:
        accept(query)
        service.end_task("t1", "failed", None)

    service.handlers["cmd/cancel"] = cancel
    thread = later(lambda: interrupt(service, "result"))
    ended = shell("start", "--wait", "--owner", "ana")
    thread.join()
    assert ended.code == 130
    assert "failed" in ended.out
    assert service.requests[-1] == ("cancel", {"owner": "ana", "reason": "Ctrl-C"})


def test_ctrl_c_leaves_a_followed_task_running(service: FakeService, shell: Shell) -> None:
    thread = later(lambda: interrupt(service, "result"))
    ended = shell("start", "--follow")
    thread.join()
    assert ended.code == 130
    assert [command for command, _ in service.requests] == ["start"]
    assert service.requests[0][1]["token"] == ""


def test_watch_follows_the_running_task_to_its_result(service: FakeService, shell: Shell) -> None:
    service.engine["task"] = "t1"

    def go_on() -> None:
        until(lambda: service.watched("result"), "nobody listens")
        asked = service.asked.count("status")
        until(lambda: service.asked.count("status") > asked, "nobody asks whether a task is running")
        service.publish("estimate", to_bytes(BELIEF))
        service.publish("estimate", to_bytes(BELIEF), skip=2)
        service.publish("result", to_bytes(ENDED))
        service.end_task("t1")

    thread = later(go_on)
    ended = shell("watch", "--json")
    thread.join()
    assert ended.code == 0
    assert "2 messages were lost" in ended.err
    lines = [json.loads(line) for line in ended.out.splitlines()]
    assert [line.get("topic") for line in lines] == ["estimate", "estimate", "result", None]
    assert lines[0]["message"]["candidates"][0]["name"] == "decaf"
    assert lines[-1]["result"]["object"] == "tea"


def test_watch_draws_on_terminals(service: FakeService, shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = io.StringIO()
    monkeypatch.setattr(live, "people", Console(file=drawn, force_terminal=True, width=120))
    service.engine["task"] = "t1"

    def go_on() -> None:
        until(lambda: service.watched("log"), "nobody listens")
        service.publish("estimate", to_bytes(BELIEF))
        service.publish("log", Log(level=Log.WARNING, name="rig", message="warm [x]").SerializeToString())
        until(lambda: "decaf" in drawn.getvalue(), "the table is not drawn")
        service.end_task("t1")

    thread = later(go_on)
    ended = shell("watch")
    thread.join()
    assert ended.code == 0
    assert "It is tea" in ended.out
    assert "rig: warm [x]" in ended.err


@pytest.mark.parametrize("probability", [None, 0.625])
def test_the_live_table_shows_probabilities_where_there_are_any(
    probability: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = io.StringIO()
    monkeypatch.setattr(live, "people", Console(file=drawn, force_terminal=True, width=120))
    unknown = None if probability is None else 0.25
    with live.LiveTable("decaf") as table:
        table.hear(7, replace(BELIEF, candidates=(replace(DECAF, probability=probability),), unknown=unknown))
    assert "decaf (truth)" in drawn.getvalue()
    for words in ("probability", "62.5 %", "none of them", "25.0 %"):
        assert (words in drawn.getvalue()) is (probability is not None)


def test_what_was_noted_stays_below_the_live_table(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = io.StringIO()
    monkeypatch.setattr(live, "people", Console(file=drawn, force_terminal=True, width=120))
    with live.LiveTable() as table:
        table.hear(7, replace(BELIEF, iteration=4, note="the light has changed"))
        before = drawn.tell()
        table.hear(8, replace(BELIEF, iteration=5))
        assert "look 4: the light has changed" in drawn.getvalue()[before:]


def test_an_estimate_that_is_told_again_is_noted_once(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = io.StringIO()
    monkeypatch.setattr(live, "people", Console(file=drawn, force_terminal=True, width=120))
    last = replace(BELIEF, iteration=4, note="the light has changed")
    with live.LiveTable() as table:
        table.hear(7, last)
        before = drawn.tell()
        table.hear(8, replace(last, phase=Phase.DONE))
        assert drawn.getvalue()[before:].count("look 4: the light has changed") == 1


def test_watch_tells_the_task_that_has_just_ended(service: FakeService, shell: Shell) -> None:
    service.end_task("t1", "undecided", None)
    ended = shell("watch")
    assert (ended.code, ended.out.splitlines()[0]) == (3, "undecided: rated 5 times better.")


def test_watch_without_any_task(service: FakeService, shell: Shell) -> None:
    ended = shell("watch")
    assert (ended.code, ended.out) == (1, "")
    assert "no task has run on rig 'bench' yet: `viewsep start`" in ended.err


@pytest.mark.parametrize(
    ("typed", "sent", "out"),
    [
        ("cancel --reason lunch", ("cancel", {"reason": "lunch"}), "cancelled"),
        ("stop", ("stop", {"reason": ""}), "stopped: engine, rig"),
        ("home", ("home", {"token": ""}), "on the way to 0.00, 0.00 deg"),
        ("move --joints -10,20", ("move", {"joints_deg": [-10.0, 20.0]}), "on the way to 10.00, -20.00 deg"),
        ("move --view=-90,30 --wait", ("move", {"view_deg": [-90.0, 30.0]}), "at 10.00, -20.00 deg"),
        ("clear-fault", ("clear_fault", {}), "cleared"),
        ('request record {"enabled":false}', ("record", {"enabled": False}), '"accepted": true'),
    ],
)
def test_requests_say_what_was_asked(
    service: FakeService, shell: Shell, typed: str, sent: tuple[str, Table], out: str
) -> None:
    ended = shell(*typed.split(), "--owner", "ana")
    assert (ended.code, ended.err) == (0, "")
    assert out in ended.out
    command, request = service.requests[-1]
    assert command == sent[0]
    assert {"owner": "ana", **sent[1]}.items() <= request.items()
    if not typed.startswith("request"):
        assert shell(*typed.split(), "--json").json["accepted"] is True


def test_stop_names_who_is_silent(shell: Shell) -> None:
    with fake_service(roles=("rig",)) as alone:
        ended = shell("stop", "--connect", alone.endpoint)
        assert (ended.code, ended.out) == (0, "stopped: rig; no answer from: engine\n")
        alone.handlers["cmd/stop"] = silent(alone)
        assert shell("stop", "--connect", alone.endpoint, "--timeout", "0.2").code == 1


BAD = {
    "endpoint without a port": ("status --connect tcp/127.0.0.1", r"'tcp/127\.0\.0\.1' is no endpoint: write tcp/"),
    "endpoint of another protocol": ("status --connect udp/127.0.0.1:7447", "udp/127"),
    "endpoint with a large port": ("rigs --connect tcp/127.0.0.1:99999", "99999"),
    "not loopback": ("status --connect tcp/192.0.2.1:7447", "without keys"),
    "rig unknown": ("status --rig crane", "no rig 'crane' at .*: choose bench"),
    "rig with a star": ("status --rig *", "rig '\\*': a rig's name has"),
    "rig for start": ("start --rig crane", "no rig 'crane'"),
    "tolerance of nothing": ("start --pose-tolerance 0", "--pose-tolerance 0: give degrees above 0 and up to 180"),
    "wait and follow": ("start --wait --follow", "--wait and --follow exclude each other"),
    "empty candidate": ("start --candidates tea,", "--candidates 'tea,' has an empty name"),
    "view of one number": ("move --view 90", "--view '90': write azimuth and elevation, e.g. --view 90,30"),
    "view of words": ("move --view up,down", "--view 'up,down': write azimuth"),
    "view not finite": ("move --view nan,0", "--view 'nan,0'"),
    "joints of words": ("move --joints pan", "--joints 'pan': write one number per joint"),
    "view and joints": ("move --joints 1,2 --view 1,2", "give --joints or --view, and not both"),
    "neither": ("move", "give --joints or --view"),
    "no JSON": ("request record {", "'{' is not JSON"),
    "JSON but no object": ("request record []", "is not a JSON object"),
    "command with a star": ("request *", "cannot be the name of a request"),
}


@pytest.mark.parametrize(("typed", "words"), BAD.values(), ids=BAD)
def test_bad_input_ends_in_one_sentence(service: FakeService, shell: Shell, typed: str, words: str) -> None:
    ended = shell(*typed.split())
    assert one_sentence(ended, words) == 2


def one_sentence(ended: Ended, words: str) -> object:
    """The exit code of a command that failed with one sentence that holds `words`."""
    assert ended.out == ""
    assert ended.err.startswith("viewsep: ")
    assert len(ended.err.splitlines()) == 1, ended.err
    assert pytest.RaisesExc(Exception, match=words).matches(Exception(ended.err)), ended.err
    return ended.code


@pytest.mark.parametrize(("code", "exit_code"), [("busy", 1), ("unknown_model", 2)])
def test_a_refusal_is_one_sentence(service: FakeService, shell: Shell, code: str, exit_code: int) -> None:
    service.handlers["cmd/start"] = refuse(code, "not now: try again")
    assert one_sentence(shell("start"), "not now: try again") == exit_code


def test_damaged_and_missing_answers_are_one_sentence(service: FakeService, shell: Shell) -> None:
    service.handlers["status"] = raw(b"<html>")
    assert one_sentence(shell("status"), "is not JSON: '<html>'") == 1
    nobody = shell("status", "--connect", f"tcp/127.0.0.1:{free_port()}", "--timeout", "0.2")
    assert one_sentence(nobody, "not running, or not allowed") == 1
