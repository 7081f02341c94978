"""The loop keeps its deadlines, turns everything that goes wrong into events, and repeats itself exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pytest
from seed_method import seed_config

from viewsep.assembly import make_engine
from viewsep.config import Config, RigConfig, TaskConfig
from viewsep.descriptors.cch import ColourCooccurrence
from viewsep.engine.engine import Engine
from viewsep.errors import MoveRefused, NotConnected, RigError, Timeout
from viewsep.geometry import angle_between, delaunay_edges, equidistant_sphere
from viewsep.interfaces import JointLimits
from viewsep.kinematics import PRESETS, preset
from viewsep.learning import learn_objects, names_for
from viewsep.messages import (
    CancelRequested,
    Command,
    DeadlinePassed,
    Estimate,
    Event,
    Frame,
    FrameMissing,
    HypothesisViews,
    JointState,
    Keyframe,
    Message,
    MoveFailed,
    MoveSettled,
    MoveTo,
    Outcome,
    PerceptReceived,
    Result,
    RigFailed,
    Stop,
    TaskStarted,
)
from viewsep.models.aspect_graph import AspectGraph, Provenance
from viewsep.perception import RigPerception, position_at
from viewsep.recordings.codec import to_bytes
from viewsep.session import Pace, Rig, Session
from viewsep.sim.clock import SimClock
from viewsep.task import Task, run_task

SECOND_NS = 1_000_000_000
READ_NS = 10_000_000


@dataclass
class ScriptedMotion:
    """Arrives at once, unless it stays away or is restless, refuses, or has a fault. Reads back every 10 ms."""

    clock: SimClock
    joints: tuple[JointLimits, ...]
    stays_away: bool = False
    restless: bool = False
    refuses: bool = False
    faults: str = ""
    deaf: bool = False
    breaks_on_close: bool = False
    calls: list[str] = field(default_factory=list)
    targets: list[tuple[int, tuple[float, ...]]] = field(default_factory=list)

    def connect(self) -> None:
        self.calls.append("connect")
        self.targets = [(-1, (0.0,) * len(self.joints))]

    def limits(self) -> tuple[JointLimits, ...]:
        return self.joints

    def move_to(self, position_rad: Sequence[float]) -> tuple[float, ...]:
        self.calls.append("move_to")
        if self.refuses:
            raise MoveRefused("joint 'pan' is jammed: free it")
        if not self.stays_away:
            self.targets.append((self.clock.now_ns(), tuple(position_rad)))
        return tuple(position_rad)

    def read_state(self) -> JointState:
        return self._state(self.clock.now_ns() // READ_NS * READ_NS)

    def history(self, since_ns: int) -> tuple[JointState, ...]:
        if self.deaf:
            return ()
        first = max(0, since_ns) // READ_NS * READ_NS
        return tuple(self._state(stamp) for stamp in range(first, self.clock.now_ns() + 1, READ_NS))

    def stop(self) -> None:
        self.calls.append("stop")

    def fault(self) -> str:
        return self.faults

    def clear_fault(self) -> None:
        self.faults = ""

    def temperatures_c(self) -> tuple[float | None, ...]:
        return (None,) * len(self.limits())

    def counters(self) -> dict[str, int]:
        return {}

    def close(self) -> None:
        self.calls.append("close")
        if self.breaks_on_close:
            raise RigError("the motion does not close")

    def _state(self, stamp_ns: int) -> JointState:
        position = [q for since, q in self.targets if since < stamp_ns][-1]
        return JointState(stamp_ns, position, self.targets[-1][1], self.restless)


@dataclass
class ScriptedCamera:
    """Exposes between the read-backs and remembers 50 ms; nothing while `dark`, without the object while `empty`."""

    clock: SimClock
    dark: bool = False
    empty: bool = False
    breaks_on_connect: bool = False
    breaks_on_close: bool = False
    calls: list[str] = field(default_factory=list)
    sequence: int = 0

    def connect(self) -> None:
        self.calls.append("connect")
        if self.breaks_on_connect:
            raise RigError("no camera")

    def read(self, newer_than_ns: int, timeout_s: float) -> Frame:
        if self.dark:
            self.clock.sleep_until(self.clock.now_ns() + round(timeout_s * 1e9))
            raise Timeout(f"no frame within {timeout_s:g} s")
        oldest_ns = max(newer_than_ns + 1, self.clock.now_ns() - 5 * READ_NS)
        stamp_ns = -(-oldest_ns // READ_NS) * READ_NS + READ_NS // 3
        self.clock.sleep_until(stamp_ns)
        self.sequence += 1
        image = np.random.default_rng(self.sequence).integers(0, 256, (24, 24, 3), np.uint8)
        return Frame(stamp_ns, self.sequence, image, np.full((24, 24), not self.empty))

    @property
    def drops(self) -> int:
        return 0

    def close(self) -> None:
        self.calls.append("close")
        if self.breaks_on_close:
            raise RigError("the camera does not close")


@dataclass
class Notes:
    """Writes down all that is heard."""

    heard: list[tuple[int, Message]] = field(default_factory=list)

    def hear(self, stamp_ns: int, message: Message) -> None:
        self.heard.append((stamp_ns, message))

    @property
    def messages(self) -> list[Message]:
        return [message for _, message in self.heard]

    def of(self, kind: type[Message]) -> list[Message]:
        return [message for message in self.messages if isinstance(message, kind)]


def models() -> list[AspectGraph]:
    nodes = equidistant_sphere(30)
    rng = np.random.default_rng(0)
    descriptor = ColourCooccurrence()
    return [
        AspectGraph(
            name=name,
            directions=nodes,
            edges=delaunay_edges(nodes),
            features=rng.random((30, 320), np.float32) / 160,
            thumbnails=np.zeros((30, 1, 1, 3), np.uint8),
            descriptor=descriptor.name,
            descriptor_parameters=descriptor.parameters,
            provenance=Provenance("", "", ""),
        )
        for name in ("a", "b")
    ]


FEW_LOOKS = seed_config(task={"max_looks": 12, "max_missing_frames": 4})
MODELS = models()


@cache  # an engine remembers nothing, so one serves all sessions
def few_looks_engine() -> Engine:
    return make_engine(FEW_LOOKS, MODELS)


@dataclass
class Scripted:
    """A session on scripted devices. `rig_preset` is what the session moves, the engine plans for a gimbal."""

    motion: ScriptedMotion
    camera: ScriptedCamera
    clock: SimClock
    session: Session
    notes: Notes

    def run(self) -> Result:
        with self.session:
            return self.session.run(3)


def scripted(rig_preset: str = "gimbal", pace: Pace | None = None) -> Scripted:
    clock, geometry, notes = SimClock(), preset(rig_preset), Notes()
    motion, camera = ScriptedMotion(clock, geometry.limits), ScriptedCamera(clock)
    rig = Rig(motion, camera, geometry, clock)
    session = Session(rig, few_looks_engine(), RigPerception(rig, ColourCooccurrence()), pace, [notes])
    return Scripted(motion, camera, clock, session, notes)


def failures(notes: Notes) -> list[MoveFailed]:
    return [message for message in notes.messages if isinstance(message, MoveFailed)]


# ---- what goes wrong becomes an event ----


def test_a_frame_that_does_not_come_is_missing() -> None:
    case = scripted(pace=Pace(frame_timeout_s=0.5))
    case.camera.dark = True
    result = case.run()
    missing = [message for message in case.notes.messages if isinstance(message, FrameMissing)]
    assert [event.reason for event in missing] == ["no frame within 0.5 s"] * 4
    assert result.outcome is Outcome.FAILED
    assert case.notes.of(PerceptReceived) == []


def test_a_frame_without_the_object_is_missing_and_names_why() -> None:
    case = scripted()
    case.camera.empty = True
    assert case.run().outcome is Outcome.FAILED
    missing = [message for message in case.notes.messages if isinstance(message, FrameMissing)]
    assert len(missing) == 4
    assert all("covers too little" in event.reason for event in missing)
    assert [m.stamp_ns for m in missing] == [f.stamp_ns for f in case.notes.messages if isinstance(f, Frame)]


def test_a_frame_without_read_backs_is_missing_after_a_while() -> None:
    case = scripted(pace=Pace(frame_timeout_s=0.3))
    case.motion.deaf = True
    assert case.run().outcome is Outcome.FAILED
    missing = [message for message in case.notes.messages if isinstance(message, FrameMissing)]
    assert len(missing) == 4
    assert "read-backs" in missing[0].reason
    assert case.clock.now_ns() < 4 * SECOND_NS


def test_a_motion_fault_fails_the_move() -> None:
    case = scripted()
    case.motion.faults = "joint 'pan' is too hot: let it cool"
    result = case.run()
    assert [event.reason for event in failures(case.notes)] == [case.motion.faults] * 3
    assert [event.command_id for event in failures(case.notes)] == [0, 1, 2]
    assert result.reason == f"3 moves failed in a row: {case.motion.faults}"
    assert case.motion.calls[-2:] == ["stop", "close"]


@pytest.mark.parametrize(("stays_away", "restless"), [(True, True), (True, False), (False, True)])
def test_a_move_that_never_settles_fails_at_its_deadline(stays_away: bool, restless: bool) -> None:
    case = scripted(pace=Pace(move_timeout_s=2.0))
    case.motion.stays_away, case.motion.restless = stays_away, restless
    result = case.run()
    assert result.outcome is Outcome.FAILED
    for i, event in enumerate(failures(case.notes), start=1):
        assert "did not arrive within 2 s" in event.reason
        assert 2.0 * i < event.stamp_ns / SECOND_NS < 2.0 * i + 0.3
    assert len(failures(case.notes)) == 3


def test_a_refused_move_fails_with_the_motions_own_words() -> None:
    case = scripted()
    case.motion.refuses = True
    assert case.run().reason == "3 moves failed in a row: joint 'pan' is jammed: free it"
    assert case.clock.now_ns() == 0


def test_a_view_the_rig_cannot_show_fails_and_nothing_moves() -> None:
    case = scripted(rig_preset="turntable")  # the engine believes in a gimbal
    assert case.run().outcome is Outcome.FAILED
    assert all("rig 'turntable' cannot show the view" in event.reason for event in failures(case.notes))
    assert "move_to" not in case.motion.calls


def test_another_error_of_the_rig_ends_the_task_as_failed_and_says_why() -> None:
    case = scripted()

    def unplugged(position_rad: Sequence[float]) -> tuple[float, ...]:
        raise NotConnected("the motion was unplugged")

    case.motion.move_to = unplugged  # type: ignore[method-assign]
    result = case.run()
    assert (result.outcome, result.reason) == (Outcome.FAILED, "the motion was unplugged")
    assert len(case.notes.of(RigFailed)) == 1
    assert case.motion.calls[-1] == "close"
    assert case.camera.calls[-1] == "close"


# ---- ends ----


@dataclass
class CancelsAfter:
    """Cancels the session at the given look."""

    session: Session
    look: int

    def hear(self, stamp_ns: int, message: Message) -> None:
        if isinstance(message, Estimate) and message.iteration == self.look:
            self.session.cancel("lunch")


def test_cancel_ends_the_task_in_order() -> None:
    case = scripted()
    case.session.listeners = [case.notes, CancelsAfter(case.session, 3)]
    result = case.run()
    assert (result.outcome, result.reason, result.looks) == (Outcome.FAILED, "cancelled: lunch", 3)
    assert [type(message) for message in case.notes.messages[-4:]] == [CancelRequested, Estimate, Stop, Result]
    assert case.notes.messages[-1] is result
    assert case.motion.calls[-2:] == ["stop", "close"]


def test_a_session_can_run_again_after_a_cancelled_task() -> None:
    case = scripted()
    canceller = CancelsAfter(case.session, 3)
    case.session.listeners = [canceller]
    with case.session:
        assert case.session.run(3).outcome is Outcome.FAILED
        canceller.look = -1
        assert case.session.run(3).outcome is not Outcome.FAILED


def test_the_deadline_of_the_task_is_kept() -> None:
    case = scripted(pace=Pace(deadline_s=1.0))
    result = case.run()
    assert (result.outcome, result.reason) == (Outcome.UNDECIDED, "the time for the task is over")
    assert SECOND_NS < result.stamp_ns < 1.5 * SECOND_NS
    assert len(case.notes.of(DeadlinePassed)) == 1


def test_looks_keep_their_pace() -> None:
    case = scripted(pace=Pace(look_period_s=0.4))
    case.run()
    stamps = [message.stamp_ns for message in case.notes.messages if isinstance(message, Frame)]
    assert np.diff(stamps).min() >= 0.4 * SECOND_NS
    assert np.diff(stamps).max() < 0.4 * SECOND_NS + 3 * READ_NS


@pytest.mark.parametrize("broken", [("motion",), ("camera",), ("motion", "camera")])
def test_closing_tries_motion_and_camera_and_raises_the_first_error(broken: tuple[str, ...]) -> None:
    case = scripted()
    case.motion.breaks_on_close = "motion" in broken
    case.camera.breaks_on_close = "camera" in broken
    with pytest.raises(RigError, match=f"the {broken[0]} does not close"), case.session:
        pass
    assert (case.motion.calls, case.camera.calls) == (["connect", "close"],) * 2


def test_without_a_camera_the_motion_is_closed_again() -> None:
    case = scripted()
    case.camera.breaks_on_connect = True
    with pytest.raises(RigError, match="no camera"), case.session:
        pytest.fail("the session must not start")
    assert case.motion.calls == ["connect", "close"]


# ---- what listeners hear ----


def check_order(heard: Sequence[Message], engine: Engine) -> None:
    """Every event is followed by exactly what the engine makes of it, in order."""
    state = engine.start()
    expected: list[Event | Command | Estimate | Result | Keyframe] = []
    crossing = [message for message in heard if not isinstance(message, JointState | Frame | HypothesisViews)]
    for message in crossing:
        if isinstance(message, Keyframe):
            expected.append(Keyframe(message.stamp_ns, engine.save(state)))
            continue
        if isinstance(message, MoveTo | Stop | Estimate | Result):
            continue
        before = state
        state, commands = engine.step(before, message)
        expected.append(message)
        if state.estimate is not None and state.estimate is not before.estimate:
            expected.append(state.estimate)
        expected += commands
        if state.result is not None and before.result is None:
            expected.append(state.result)
    assert [to_bytes(message) for message in crossing] == [to_bytes(message) for message in expected]


@pytest.mark.parametrize("trouble", ["none", "dark", "refuses", "faults"])
def test_every_event_is_heard_before_what_the_engine_makes_of_it(trouble: str) -> None:
    case = scripted()
    case.camera.dark = trouble == "dark"
    case.motion.refuses = trouble == "refuses"
    case.motion.faults = "hot" if trouble == "faults" else ""
    case.run()
    check_order(case.notes.messages, few_looks_engine())
    first = next(message for message in case.notes.messages if not isinstance(message, JointState))
    assert isinstance(first, TaskStarted)


def check_read_backs(notes: Notes, rig_preset: str) -> None:
    """Whoever listens can work out every percept's view from the read-backs heard before it."""
    read_backs: list[JointState] = []
    percepts = 0
    for message in notes.messages:
        if isinstance(message, JointState):
            assert not read_backs or message.stamp_ns > read_backs[-1].stamp_ns
            read_backs.append(message)
        elif isinstance(message, PerceptReceived):
            position = position_at(message.stamp_ns, read_backs)
            view = preset(rig_preset).view_direction(position.tolist())
            np.testing.assert_allclose(message.percept.view_direction, view, atol=1e-12)
            percepts += 1
    assert percepts > 0


def test_read_backs_around_every_percept_are_heard_once_and_in_order() -> None:
    case = scripted()
    case.run()
    check_read_backs(case.notes, "gimbal")


def test_what_was_heard_carries_its_own_time() -> None:
    case = scripted()
    case.run()
    for stamp_ns, message in case.notes.heard:
        if not isinstance(message, MoveTo | Stop):
            assert message.stamp_ns == stamp_ns


# ---- on the simulated rig ----

SOURCES = ("generated:7", "generated:7:twin=face")


@pytest.fixture(scope="module")
def learned() -> list[AspectGraph]:
    names = names_for(SOURCES, None)
    found = learn_objects(SOURCES, names, 24, Config(), jobs=1)
    return sorted(found, key=lambda model: model.name)


def simulated(config: Config, learned: Sequence[AspectGraph], seed: int) -> Notes:
    notes = Notes()
    truth = learned[0]
    run_task(Task(truth.provenance.source, truth.name, seed), config, learned, [notes])
    return notes


def heard_bytes(notes: Notes) -> list[bytes]:
    told = [message for message in notes.messages if not isinstance(message, HypothesisViews)]
    return [message.image.tobytes() if isinstance(message, Frame) else to_bytes(message) for message in told]


def rig_config(rig_preset: str, looks: int, pose_tolerance_deg: float | None = None) -> Config:
    task = TaskConfig(max_looks=looks, pose_tolerance_deg=pose_tolerance_deg)
    return Config(rig=RigConfig(preset=rig_preset), task=task)


@pytest.mark.needs_pybullet
def test_the_same_seed_gives_the_same_bytes(learned: list[AspectGraph]) -> None:
    first = simulated(rig_config("gimbal", 25), learned, 5)
    again = simulated(rig_config("gimbal", 25), learned, 5)
    other = simulated(rig_config("gimbal", 25), learned, 6)
    assert heard_bytes(first) == heard_bytes(again)
    assert heard_bytes(first) != heard_bytes(other)
    check_order(first.messages, make_engine(rig_config("gimbal", 25), learned))


@pytest.mark.needs_pybullet
@pytest.mark.parametrize("rig_preset", PRESETS)
def test_every_preset_carries_a_task_to_its_end(rig_preset: str, learned: list[AspectGraph]) -> None:
    notes = simulated(rig_config(rig_preset, 25, 3.5), learned, 2)  # the name alone may take three moves
    (result,) = [message for message in notes.messages if isinstance(message, Result)]
    assert result.outcome in (Outcome.IDENTIFIED, Outcome.UNDECIDED)
    assert result.looks >= 5
    assert failures(notes) == []
    assert len(notes.of(MoveSettled)) > 3
    check_read_backs(notes, rig_preset)


@pytest.mark.needs_pybullet
def test_on_a_turntable_only_views_on_its_ring_are_asked_for(learned: list[AspectGraph]) -> None:
    notes = simulated(rig_config("turntable", 40, pose_tolerance_deg=1.0), learned, 1)
    moves = [message.view_direction for message in notes.messages if isinstance(message, MoveTo)]
    turntable = preset("turntable")
    ring = turntable.view_directions(np.linspace(0.0, 2.0 * np.pi, 7200)[:, None])
    away = [float(angle_between(ring, view).min()) for view in moves]
    assert len(moves) > 5
    assert np.degrees(max(away)) < 0.1
