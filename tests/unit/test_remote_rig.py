"""A rig in another process does what a local one does, to the byte, and survives a line that is cut."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pytest
import zenoh
from cut_line import Line
from hypothesis import given
from hypothesis import strategies as st
from rig_on_zenoh import KEYS, Station, open_session, remote_rig, station, wait_for
from seed_method import seed_config

from viewsep.assembly import make_engine
from viewsep.camera_config import CameraConfig
from viewsep.config import Config, DescriptorConfig, RigConfig, SimConfig, TaskConfig, parse_config
from viewsep.errors import BadConfig, LeaseLost, MoveRefused, NotConnected, RigError, RigLost, Timeout, UnreachableView
from viewsep.learning import learn_objects, names_for
from viewsep.messages import (
    Frame,
    HypothesisViews,
    JointState,
    Message,
    MoveSettled,
    Outcome,
    PerceptReceived,
    Result,
    RigFailed,
)
from viewsep.models.aspect_graph import AspectGraph
from viewsep.perception import RigPerception
from viewsep.plugins import make_descriptor
from viewsep.recordings.codec import to_bytes
from viewsep.rigs import pace_of, simulated_rig
from viewsep.service.calls import CALLS, error_from, error_reply
from viewsep.service.link import ClockEstimate
from viewsep.service.looks import Send
from viewsep.service.remote import RemoteRig
from viewsep.service.requests import Code, Refused
from viewsep.session import Rig, Session

pytestmark = pytest.mark.needs_pybullet

SECOND_NS = 1_000_000_000
SOURCES = ("generated:7", "generated:7:twin=face")
CONFIG = seed_config(rig={"preset": "gimbal"}, task={"max_looks": 25})
SMALL = Config(rig=RigConfig(preset="turntable"), camera=CameraConfig(size_px=48))


@cache
def learned() -> list[AspectGraph]:
    found = learn_objects(SOURCES, names_for(SOURCES, None), 40, seed_config(), jobs=1)
    return sorted(found, key=lambda model: model.name)


@dataclass
class Notes:
    """Writes down what is heard, but pictures."""

    heard: list[Message] = field(default_factory=list)
    on_percept: dict[int, object] = field(default_factory=dict)

    def hear(self, _stamp_ns: int, message: Message) -> None:
        if isinstance(message, PerceptReceived):
            action = self.on_percept.pop(self.count(PerceptReceived), None)
            if callable(action):
                action()
        if not isinstance(message, Frame):
            self.heard.append(message)

    def count(self, kind: type[Message]) -> int:
        return sum(isinstance(message, kind) for message in self.heard)

    def bytes(self) -> list[bytes]:
        return [to_bytes(message) for message in self.heard if not isinstance(message, Frame | HypothesisViews)]


def run_remotely(remote: RemoteRig, notes: Notes, config: Config = CONFIG, send: Send = "descriptor") -> Result:
    config = remote.config(config)
    engine = make_engine(config, learned())
    perception = remote.perception(config.descriptor, send)
    with Session(remote.lent_to("a task"), engine, perception, pace_of(config), [notes]) as session:
        return session.run(5)


@cache
def local_bytes() -> list[bytes]:
    notes = Notes()
    rig = simulated_rig(CONFIG, "generated:7", 5).rig
    perception = RigPerception(rig, make_descriptor(CONFIG.descriptor))
    with Session(rig, make_engine(CONFIG, learned()), perception, pace_of(CONFIG), [notes]) as session:
        session.run(5)
    return notes.bytes()


def viewsep_threads() -> list[str]:
    return [thread.name for thread in threading.enumerate() if thread.name.startswith("viewsep")]


# ---- the same as a local rig ----


def test_a_stepped_task_over_the_line_is_the_local_one_to_the_byte_and_leaves_no_thread() -> None:
    notes = Notes()
    with station(CONFIG, seed=5) as here, remote_rig(here) as remote:
        result = run_remotely(remote, notes)
        assert here.served.motion.lease.holder == ""
        assert remote.link.up
    assert result.looks == 25
    assert notes.count(JointState) > 100
    assert notes.bytes() == local_bytes()
    assert viewsep_threads() == []


@pytest.mark.parametrize("send", ["image", "crop"])
def test_percepts_of_pictures_are_nearly_those_of_the_rig(send: Send) -> None:
    config = SMALL.model_copy(update={"camera": CameraConfig(size_px=128)})
    descriptor = make_descriptor(config.descriptor)
    with station(config) as here, remote_rig(here) as remote, lent(remote) as rig:
        served = here.served
        local = RigPerception(Rig(served.motion, served.camera, served.geometry, served.clock), descriptor)
        for _ in range(3):
            rig.motion.move_to([1.0 + rig.motion.read_state().position_rad[0]])
            look = remote.perception(config.descriptor, send).look(rig.clock.now_ns(), 1.0)
            assert look.percept is not None
            assert look.frame is not None
            truth = local.look(look.stamp_ns - 1, 1.0)  # the rig remembers
            assert truth.percept is not None
            assert truth.frame is not None
            np.testing.assert_array_equal(look.percept.view_direction, truth.percept.view_direction)
            np.testing.assert_array_equal(look.frame.mask, truth.frame.mask)
            assert look.frame.image.shape == truth.frame.image.shape
            assert descriptor.similarity(look.percept.feature, truth.percept.feature[None])[0] > 0.9
            assert look.percept.descriptor == descriptor.name
            error = look.frame.image.astype(int) - truth.frame.image
            assert np.abs(error[truth.frame.mask]).mean() < 4.0
            assert truth.frame.mask is not None
            outside = look.frame.image[np.logical_not(truth.frame.mask)]
            assert (outside == 255).mean() > (0.9 if send == "crop" else 0.0)


@pytest.mark.parametrize("send", ["descriptor", "image"])
def test_in_pictures_without_masks_the_object_is_found_at_the_rigs_side(send: Send) -> None:
    tables = {
        "camera": {"source": "staged", "size_px": 64},
        "perception": {"method": "plain"},
        "stage": {"background": "plain", "plate": False},
        "rig": {"preset": "turntable"},
    }
    config = parse_config(tables, "test")
    with station(config) as here, remote_rig(here) as remote, lent(remote) as rig:
        assert remote.config(Config()) == Config.model_validate(tables)
        look = remote.perception(config.descriptor, send).look(rig.clock.now_ns(), 1.0)
        assert look.problem == ""
        assert look.percept is not None
        assert look.percept.feature.shape == (make_descriptor(config.descriptor).size,)
        if send == "image":
            assert look.frame is not None
            assert look.frame.mask is not None
            assert look.frame.image.shape == (64, 64, 3)
            assert 0.1 < look.frame.mask.mean() < 0.8


def test_what_the_rig_is_comes_over_exactly() -> None:
    config = SMALL.model_copy(update={"sim": SimConfig(noise=0.1)})
    with station(config, speed=3.0, lease_s=1.5) as here, remote_rig(here) as remote:
        said = remote.description
        assert (said.speed, said.lease_s, said.simulated) == (3.0, 1.5, True)
        assert (said.holds, said.pictures) == ("generated:7", "rendered")
        assert said.limits == here.served.motion.limits()  # infinite ones too
        assert remote.config(Config()) == Config(rig=config.rig, camera=config.camera, sim=config.sim)
        offset_s, round_trip_s = remote.link.clock_offset_s, remote.link.round_trip_s
        assert offset_s is not None
        assert round_trip_s is not None
        rig = remote.lent_to("somebody")
        for _ in range(20):
            before_ns = here.served.clock.now_ns()
            here_ns = rig.clock.now_ns()
            after_ns = here.served.clock.now_ns()
            slack_ns = 3.0 * SECOND_NS * round_trip_s
            assert before_ns - slack_ns <= here_ns <= after_ns + slack_ns


# ---- errors ----


@contextmanager
def lent(remote: RemoteRig, holder: str = "a test") -> Iterator[Rig]:
    rig = remote.lent_to(holder)
    rig.motion.connect()
    rig.camera.connect()
    try:
        yield rig
    finally:
        rig.motion.close()
        rig.camera.close()


SENTENCES = st.text(min_size=1, max_size=60)
KINDS = [RigError, NotConnected, MoveRefused, Timeout, UnreachableView, LeaseLost, BadConfig]


@given(st.sampled_from(KINDS), SENTENCES)
def test_errors_cross_the_wire_as_what_they_were(kind: type[RigError], sentence: str) -> None:
    again = error_from(error_reply("look", kind(sentence)))
    assert type(again) is kind
    assert str(again) == sentence


@given(st.sampled_from(Code), SENTENCES)
def test_refusals_keep_their_code(code: Code, sentence: str) -> None:
    again = error_from(error_reply("acquire", Refused(code, sentence)))
    assert isinstance(again, Refused)
    assert (again.code, str(again)) == (code, sentence)


@given(st.binary(max_size=50) | st.recursive(st.none() | st.text(), st.lists).map(lambda x: json.dumps(x).encode()))
def test_an_error_that_cannot_be_read_is_one_of_the_rig(data: bytes) -> None:
    assert type(error_from(data)) is RigError


def test_what_goes_wrong_at_the_rig_goes_wrong_here() -> None:
    config = Config(rig=RigConfig(preset="pan_tilt"), camera=CameraConfig(size_px=48))
    with station(config) as here, remote_rig(here) as remote:
        rig = remote.lent_to("anna")
        with pytest.raises(NotConnected):
            rig.motion.read_state()
        with lent(remote, "ben"), pytest.raises(Refused, match="the rig is moved by ben") as refusal:
            rig.motion.connect()
        assert refusal.value.code is Code.BUSY
        with lent(remote, "anna") as rig:
            with pytest.raises(MoveRefused, match=r"joint 'tilt': set-point 171\.89 deg is outside"):
                rig.motion.move_to([3.0, 0.0])
            with pytest.raises(Timeout, match=r"no frame within 0\.5 s"):
                rig.camera.read(rig.clock.now_ns() + 9 * SECOND_NS, 0.5)
            with pytest.raises(Timeout, match=r"no frame within 0\.5 s"):
                remote.perception(DescriptorConfig(), "image").look(rig.clock.now_ns() + 9 * SECOND_NS, 0.5)
            here.served.motion.halt("the operator stopped the rig")
            for call in (rig.motion.read_state, lambda: rig.motion.move_to([0.0, 0.0]), rig.motion.stop):
                with pytest.raises(LeaseLost, match="the operator stopped the rig"):
                    call()


def ask(session: zenoh.Session, name: str, payload: bytes) -> tuple[bool, bytes]:
    """Whether it was accepted, and the reply."""
    (reply,) = session.get(KEYS.remote(name), payload=payload, timeout=10.0)
    if reply.ok is not None:
        return True, reply.ok.payload.to_bytes()
    assert reply.err is not None
    assert str(reply.err.encoding) == "application/json"
    return False, reply.err.payload.to_bytes()


@contextmanager
def talking_to(here: Station) -> Iterator[zenoh.Session]:
    session = open_session(connect=here.endpoint)
    try:
        wait_for(lambda: len(list(session.get(KEYS.remote("describe"), timeout=5.0))) == 1)
        yield session
    finally:
        session.close()


CALLER = {"caller": "c", "number": 1}
BAD: list[tuple[str, bytes, Code, str]] = [
    ("state", b"", Code.BAD_JSON, "not JSON"),
    ("state", b"[1]", Code.BAD_REQUEST, "dictionary"),
    ("state", b"\xff\xfe", Code.BAD_JSON, "not JSON"),
    ("state", b" " * 100_000, Code.TOO_LARGE, "too large"),
    ("dance", b"{}", Code.UNKNOWN_COMMAND, "'dance'"),
    ("state", json.dumps({**CALLER, "colour": 1}).encode(), Code.BAD_REQUEST, "colour"),
    ("move_to", json.dumps({**CALLER, "position_rad": [0.0]}).encode(), Code.BAD_REQUEST, "holder"),
    ("move_to", json.dumps({**CALLER, "holder": "a", "position_rad": ["x"]}).encode(), Code.BAD_REQUEST, "position"),
    ("move_to", json.dumps({**CALLER, "holder": "a", "position_rad": [0.0]}).encode(), Code.NOT_OWNER, "not hold"),
    ("sleep", json.dumps({**CALLER, "until_ns": 10**18}).encode(), Code.BAD_REQUEST, "60 s ahead"),
    ("sleep", json.dumps({**CALLER, "until_ns": 2**80}).encode(), Code.BAD_REQUEST, "until_ns"),
    ("frame", json.dumps({**CALLER, "newer_than_ns": 0, "timeout_s": 1e9}).encode(), Code.BAD_REQUEST, "timeout_s"),
    ("frame", b'{"caller":"c","number":1,"newer_than_ns":0,"timeout_s":NaN}', Code.BAD_REQUEST, "timeout_s"),
    (
        "look",
        json.dumps(
            {**CALLER, "newer_than_ns": 0, "timeout_s": 1.0, "send": "descriptor", "descriptor": {"name": "smell"}}
        ).encode(),
        Code.BAD_REQUEST,
        "smell",
    ),
]


def test_whatever_comes_in_is_answered_with_a_sentence_and_the_rig_goes_on() -> None:
    with station(SMALL) as here, talking_to(here) as session:
        for number, (name, payload, code, named) in enumerate(BAD):
            accepted, reply = ask(session, name, payload.replace(b'"number": 1', b'"number": %d' % number))
            said = json.loads(reply)
            assert not accepted
            assert (said["accepted"], said["command"], said["code"]) == (False, name, code.value)
            assert named in said["message"]
        assert here.served.clock.now_ns() == 0
        accepted, reply = ask(session, "state", json.dumps(CALLER).encode())
        assert accepted
        assert json.loads(reply)["state"]["position_rad"] == [0.0]
    assert set(CALLS) >= {name for name, *_ in BAD if name != "dance"}


# ---- repeated calls, cut lines ----


def test_a_repeated_call_is_answered_as_the_first_and_done_once() -> None:
    with station(SMALL) as here, talking_to(here) as session:
        frames: list[Frame] = []
        here.served.camera.on_frame(frames.append)
        look = {**CALLER, "newer_than_ns": 0, "timeout_s": 1.0, "send": "image", "descriptor": {"name": "cch"}}
        replies = {ask(session, "look", json.dumps(look).encode()) for _ in range(3)}
        assert len(replies) == len(frames) == 1
        late = {**look, "number": 2, "newer_than_ns": 10**12}
        replies = {ask(session, "look", json.dumps(late).encode()) for _ in range(2)}
        ((accepted, _reply),) = replies
        assert not accepted
        assert here.served.clock.now_ns() < 1.1 * SECOND_NS  # it waited once
        fresh = {**look, "number": 3, "newer_than_ns": here.served.clock.now_ns()}
        assert ask(session, "look", json.dumps(fresh).encode())[0]
        assert len(frames) == 2
        for name, number in (("acquire", 4), ("release", 5), ("acquire", 4)):
            ask(session, name, json.dumps({"caller": "c", "number": number, "holder": "anna"}).encode())
        assert here.served.motion.lease.holder == ""  # the late repetition took nothing


@contextmanager
def over_a_line(here: Station, *, resume_s: float) -> Iterator[tuple[RemoteRig, Line]]:
    line = Line(here.endpoint)
    session = open_session(connect=line.endpoint)
    try:
        with RemoteRig(session, KEYS, resume_s=resume_s) as remote:
            yield remote, line
    finally:
        session.close()
        line.close()


def test_a_stepped_task_over_a_line_that_is_cut_three_times_is_still_the_local_one() -> None:
    notes = Notes()
    with station(CONFIG, seed=5, lease_s=60.0) as here, over_a_line(here, resume_s=20.0) as (remote, line):

        def trouble() -> None:
            def flicker() -> None:
                line.cut()
                line.mend()

            threading.Timer(0.01, flicker).start()  # while some call is under way

        notes.on_percept = {3: trouble, 10: trouble, 17: trouble}
        run_remotely(remote, notes)
        assert notes.on_percept == {}
    assert notes.bytes() == local_bytes()


def test_a_rig_out_of_reach_holds_its_position_and_goes_on_with_its_move_when_it_is_back() -> None:
    with (
        station(SMALL, speed=4.0, lease_s=0.3) as here,
        over_a_line(here, resume_s=20.0) as (remote, line),
        lent(remote) as rig,
    ):
        served = here.served.motion
        goal = rig.motion.move_to([2.0])
        wait_for(lambda: served.read_state().position_rad[0] > 0.1)
        line.cut()
        wait_for(lambda: served.lease.lapsed() and served.read_state().setpoint_rad != goal)
        wait_for(lambda: not served.read_state().moving)
        held = served.read_state()
        assert held.position_rad[0] < 1.9
        assert not remote.link.up
        line.mend()
        state = rig.motion.read_state()
        assert state.setpoint_rad == goal
        wait_for(lambda: rig.motion.read_state().position_rad[0] > 1.99)
        assert remote.link.up


def test_a_line_that_stays_cut_ends_the_task_and_the_rig_is_free_for_others() -> None:
    notes = Notes()
    with (
        station(CONFIG, seed=5, lease_s=0.3) as here,
        over_a_line(here, resume_s=0.6) as (remote, line),
    ):
        notes.on_percept[3] = line.cut
        result = run_remotely(remote, notes)
        assert result.outcome is Outcome.FAILED
        assert "rig 'test' has not answered for 0.6 s" in result.reason
        assert notes.count(RigFailed) == 1
        wait_for(here.served.motion.lease.lapsed)
        with remote_rig(here) as other, lent(other, "somebody else"):
            assert here.served.motion.lease.holder == "somebody else"
        line.mend()
        wait_for(lambda: remote.link.up)
        with lent(remote, "the next task") as rig:  # and so it is for the next task over the same line
            rig.clock.sleep_until(rig.clock.now_ns() + SECOND_NS)
            assert not rig.motion.read_state().moving


@pytest.mark.parametrize("who", ["the operator stopped the rig", "another one"])
def test_what_was_taken_away_while_the_line_was_cut_is_not_resumed(who: str) -> None:
    with (
        station(SMALL, lease_s=0.3) as here,
        over_a_line(here, resume_s=20.0) as (remote, line),
        lent(remote) as rig,
    ):
        rig.motion.move_to([2.0])
        line.cut()
        wait_for(here.served.motion.lease.lapsed)
        if who == "another one":
            here.served.motion.acquire(who)
        else:
            here.served.motion.halt(who)
        threading.Timer(0.2, line.mend).start()
        with pytest.raises(LeaseLost, match=who):
            rig.motion.move_to([1.0])
        here.served.clock.sleep_until(SECOND_NS)
        assert here.served.motion.read_state().setpoint_rad[0] < 0.5


def test_a_servers_session_that_is_opened_again_is_found_again() -> None:
    notes = Notes()
    with station(CONFIG, seed=5, lease_s=60.0) as here, remote_rig(here, resume_s=20.0) as remote:

        def pause() -> None:
            here.go_offline()
            threading.Timer(0.5, here.go_online).start()

        notes.on_percept[3] = pause
        run_remotely(remote, notes)
        assert notes.bytes() == local_bytes()


def test_a_rig_that_is_not_there_is_lost() -> None:
    session = open_session()
    try:
        with pytest.raises(RigLost, match=r"rig 'test' has not answered for 0\.2 s"):
            RemoteRig(session, KEYS, resume_s=0.2).open()
    finally:
        session.close()
    with pytest.raises(RigLost, match="cannot be asked"):
        RemoteRig(session, KEYS, resume_s=0.2).open()
    assert viewsep_threads() == []


def test_a_paced_task_keeps_to_the_rigs_clock() -> None:
    config = CONFIG.model_copy(update={"task": TaskConfig(max_looks=6)})
    notes = Notes()
    with station(config, speed=4.0, seed=5) as here, remote_rig(here) as remote:
        result = run_remotely(remote, notes, config)
        assert result.looks == 6
        assert notes.count(MoveSettled) >= 1
        percepts = [message.stamp_ns for message in notes.heard if isinstance(message, PerceptReceived)]
        assert percepts == sorted(percepts)
        assert percepts[-1] <= here.served.clock.now_ns()


# ---- the clock ----


@given(
    st.integers(0, 10**15),
    st.integers(0, 10**15),
    st.sampled_from([0.5, 1.0, 20.0]),
    st.lists(st.tuples(st.integers(0, 10**8), st.integers(0, 10**8)), min_size=1, max_size=10),
)
def test_the_rigs_clock_is_known_to_half_the_shortest_round_trip(
    rig_zero_ns: int, local_zero_ns: int, speed: float, trips_ns: Sequence[tuple[int, int]]
) -> None:
    estimate = ClockEstimate(speed)
    local_ns = local_zero_ns
    for there_ns, back_ns in trips_ns:
        rig_ns = rig_zero_ns + round(speed * (local_ns + there_ns - local_zero_ns))
        estimate.hear(local_ns, local_ns + there_ns + back_ns, rig_ns)
        local_ns += there_ns + back_ns
    truth_ns = rig_zero_ns + speed * (local_ns - local_zero_ns)
    shortest_ns = min(there_ns + back_ns for there_ns, back_ns in trips_ns)
    assert abs(estimate.at(local_ns) - truth_ns) <= speed * (shortest_ns / 2 + 1) + 2
    assert estimate.round_trip_s == shortest_ns * 1e-9


def test_a_clock_that_was_never_heard_is_not_known() -> None:
    estimate = ClockEstimate(1.0)
    assert estimate.offset_s is None
    with pytest.raises(RigError, match="not known"):
        estimate.at(0)
