"""Feeding a recording's events to the real engine again and comparing what comes out."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from viewsep.assembly import make_engine
from viewsep.calibration.play import held_states
from viewsep.config import Config, geometry_of, parse_config
from viewsep.engine.engine import Engine
from viewsep.engine.state import EngineState
from viewsep.errors import BadConfig, BadInput, BadRecording, ReplayMismatch
from viewsep.geometry import angle_between
from viewsep.messages import (
    Command,
    Estimate,
    Event,
    FloatArray,
    JointState,
    Keyframe,
    Percept,
    PerceptReceived,
    Result,
    TaskStarted,
)
from viewsep.models import library
from viewsep.models.aspect_graph import AspectGraph
from viewsep.perception import perceive
from viewsep.plugins import make_descriptor
from viewsep.recordings.build import this_build
from viewsep.recordings.codec import SCHEMAS, Recordable, encode, to_bytes
from viewsep.recordings.difference import first_difference
from viewsep.recordings.reader import Recorded, Recording
from viewsep.recordings.version import RECOVERY

FLOAT_TOLERANCE = 1e-6  # relative, between processors or numpy builds
FEATURE_TOLERANCE = 0.85  # similarity of a percept from the JPEG to the recorded one
DIRECTION_TOLERANCE_RAD = 1e-9
Output = Estimate | Command | Result


@dataclass(frozen=True, eq=False, slots=True)
class Replayed:
    """One event, the engine's state after it and what the engine put out."""

    event: Event
    state: EngineState
    outputs: tuple[Output, ...]


@dataclass(frozen=True, slots=True)
class Verification:
    """What a replay confirmed. `exact` is False when floats differed within FLOAT_TOLERANCE on another build.

    `keyframes` counts those that were reached with the recorded state (on the recording's build), `gaps` the places
    where messages are missing, `skipped` the messages that could not be compared: before the start, and from a gap to
    the next keyframe.
    """

    events: int
    outputs: int
    exact: bool
    keyframes: int = 0
    gaps: int = 0
    skipped: int = 0


@dataclass(frozen=True, slots=True)
class FrameCheck:
    """Percepts recomputed from the recorded pictures: how many, and the least similarity to the recorded features."""

    percepts: int
    similarity_min: float
    similarity_median: float


def restore(recording: Recording) -> tuple[Config, list[AspectGraph]]:
    """Configuration and models from a recording. Raises BadRecording when they are not what the recording says."""
    try:
        config = parse_config(json.loads(recording.metadata["config"]["json"]), "the recorded configuration")
        digests = recording.metadata["models"]
        models = [
            library.from_bytes(recording.attachments[f"{name}{library.SUFFIX}"], f"attachment {name}{library.SUFFIX}")
            for name in json.loads(recording.metadata["task"]["candidates"])
        ]
    except KeyError as error:
        raise BadRecording(f"the recording lacks {error}: it was not made by `viewsep separate --record`") from error
    except (BadConfig, ValueError) as error:
        raise BadRecording(f"the recording's configuration cannot be used by this viewsep: {error}") from error
    for model in models:
        if digests.get(model.name) != model.digest:
            raise BadRecording(
                f"the recording was made with model {model.name} {digests.get(model.name, 'absent')[:12]}, "
                f"but holds {model.digest[:12]}: the file was put together from different runs"
            )
    return config, models


def use_models(recording: Recording, models: Sequence[AspectGraph]) -> None:
    """Check that models from a library are those the recording was made with. Raises BadRecording."""
    digests = recording.metadata["models"]
    for model in models:
        if digests[model.name] != model.digest:
            raise BadRecording(
                f"the recording was made with model {model.name} {digests[model.name][:12]}, but the library has "
                f"{model.digest[:12]}: replay with the library it was made with, or without --models"
            )


def replay(recording: Recording) -> Iterator[Replayed]:
    """Run the engine over the recorded events; after a gap from the next place on where its state is known."""
    replaying = Replaying(make_engine(*restore(recording)))
    for place, recorded in enumerate(recording.messages):
        if place in recording.gaps:
            replaying.lose()
        replayed = replaying.take(recorded.message)
        if replayed is not None:
            yield replayed


class Replaying:
    """The engine fed with recorded messages. `state` is None where it is not known: after a gap, until a keyframe."""

    def __init__(self, engine: Engine) -> None:
        self.engine = engine
        self.state: EngineState | None = engine.start()

    def lose(self) -> None:
        """Messages are missing here."""
        self.state = None

    def take(self, message: Recordable) -> Replayed | None:
        """Feed a message; what came of it if it is an event and the state is known."""
        if isinstance(message, Keyframe) and self.state is None:
            self.state = self.engine.restore(message.state)
        if isinstance(message, TaskStarted) and self.state is None:
            self.state = self.engine.start()
        if self.state is None or not isinstance(message, Event):
            return None
        replayed = _step(self.engine, self.state, message)
        self.state = replayed.state
        return replayed


def start_at(recording: Recording, stamp_ns: int) -> Recording:
    """The recording from the last keyframe on that is not later than `stamp_ns`.

    Raises BadRecording when there is none.
    """
    places = [
        place
        for place, recorded in enumerate(recording.messages)
        if isinstance(recorded.message, Keyframe) and recorded.stamp_ns <= stamp_ns
    ]
    if not places:
        first = next((r.stamp_ns for r in recording.messages if isinstance(r.message, Keyframe)), None)
        known = "it has none" if first is None else f"its first is at {first} ns"
        raise BadRecording(f"no keyframe at or before {stamp_ns} ns ({known}): replay from the beginning")
    begin = places[-1]
    gaps = {0, *(gap - begin for gap in recording.gaps if gap > begin)}
    return replace(recording, messages=recording.messages[begin:], gaps=frozenset(gaps))


def verify(recording: Recording) -> Verification:
    """Replay and compare every estimate, command, result and keyframe byte for byte, and which event it followed.

    Raises ReplayMismatch at the first difference. On another build or processor than the recording's, floats may
    differ by FLOAT_TOLERANCE; decisions may not. What a gap leaves without its beginning is skipped and counted.
    """
    replaying = Replaying(make_engine(*restore(recording)))
    same_build = recording.metadata.get("build") == this_build()
    tolerance = 0.0 if same_build else FLOAT_TOLERANCE
    expected: deque[Output] = deque()
    events = outputs = keyframes = skipped = 0
    exact = True
    for place, recorded in enumerate(recording.messages):
        message = recorded.message
        if place in recording.gaps:
            replaying.lose()
            expected.clear()
        if replaying.state is not None and isinstance(message, Event | Keyframe):
            _nothing_left(expected, f"before {recorded.topic} at {recorded.stamp_ns} ns")
        if replaying.state is not None and isinstance(message, Keyframe):
            keyframes += same_build and _reached(message, replaying.engine, replaying.state, recorded.stamp_ns)
        replayed = replaying.take(message)
        if replayed is not None:
            expected.extend(replayed.outputs)
            events += 1
        elif replaying.state is None:
            skipped += 1
        elif isinstance(message, Output):
            if not expected:
                raise ReplayMismatch(
                    f"the recording has {recorded.topic} at {recorded.stamp_ns} ns, which the engine did not put out"
                )
            output = expected.popleft()
            outputs += 1
            if to_bytes(output) != recorded.raw:
                exact = False
                _compare(recorded, output, tolerance)
    if RECOVERY not in recording.metadata:  # what was saved may end anywhere
        _nothing_left(expected, "at the end of the recording")
    if events == 0:
        raise BadRecording("the recording holds no events that can be replayed: nothing to verify")
    return Verification(events, outputs, exact, keyframes, len(recording.gaps), skipped)


def _step(engine: Engine, before: EngineState, event: Event) -> Replayed:
    state, commands = engine.step(before, event)
    outputs: list[Output] = []
    if state.estimate is not None and state.estimate is not before.estimate:
        outputs.append(state.estimate)
    outputs.extend(commands)
    if state.result is not None and before.result is None:
        outputs.append(state.result)
    return Replayed(event, state, tuple(outputs))


def _reached(keyframe: Keyframe, engine: Engine, state: EngineState, stamp_ns: int) -> bool:
    """Whether the keyframe was reached; False where it is an earlier engine's, which this one cannot read.

    Raises ReplayMismatch when the state is another one.
    """
    try:
        same = engine.same(state, keyframe.state)
    except BadInput:
        return False
    if not same:
        raise ReplayMismatch(f"the engine's state at {stamp_ns} ns is not the recorded one")
    return True


def _nothing_left(expected: deque[Output], where: str) -> None:
    if expected:
        raise ReplayMismatch(f"the engine put out {encode(expected[0])[0]} {where}, which the recording lacks")


def verify_frames(recording: Recording) -> FrameCheck:
    """Recompute every percept from its recorded picture and read-backs. Raises ReplayMismatch, BadRecording.

    Tolerance: features at least FEATURE_TOLERANCE similar (JPEG loses detail), view directions within
    DIRECTION_TOLERANCE_RAD.
    """
    config, _ = restore(recording)
    descriptor, geometry = make_descriptor(config.descriptor), geometry_of(config.rig)
    read = [r.message for r in recording.messages if isinstance(r.message, JointState)]
    play_deg = config.rig.backlash_deg
    history = held_states(read, np.radians(play_deg).tolist()) if any(play_deg) else read
    frames = {frame.stamp_ns: frame for frame in recording.frames}
    similarities = []
    for recorded in recording.messages:
        if not isinstance(recorded.message, PerceptReceived):
            continue
        percept = recorded.message.percept
        if percept.stamp_ns not in frames:
            raise BadRecording(f"the picture of the percept at {percept.stamp_ns} ns is not in the recording")
        again = perceive(frames[percept.stamp_ns].decode(), history, geometry, descriptor)
        similarity = descriptor.similarity(again.feature, percept.feature[None])
        similarities.append(_compare_percepts(again, percept, similarity))
    if not similarities:
        raise BadRecording("the recording holds no percepts: nothing to recompute")
    return FrameCheck(len(similarities), float(min(similarities)), float(np.median(similarities)))


def _compare_percepts(again: Percept, recorded: Percept, similarity: FloatArray) -> float:
    turned = float(angle_between(again.view_direction, recorded.view_direction))
    if turned > DIRECTION_TOLERANCE_RAD:
        raise ReplayMismatch(
            f"percept at {recorded.stamp_ns} ns: view direction differs by {np.degrees(turned):.2g} deg "
            f"(tolerance {np.degrees(DIRECTION_TOLERANCE_RAD):.2g})"
        )
    if similarity[0] < FEATURE_TOLERANCE:
        raise ReplayMismatch(
            f"percept at {recorded.stamp_ns} ns: feature from the picture is only {similarity[0]:.3f} similar to the "
            f"recorded one (tolerance {FEATURE_TOLERANCE})"
        )
    return float(similarity[0])


def _compare(recorded: Recorded, output: Output, tolerance: float) -> None:
    """Raise ReplayMismatch in words where a recorded message and the engine's differ by more than the tolerance."""
    topic, again = encode(output)
    if topic != recorded.topic:
        raise ReplayMismatch(
            f"at {recorded.stamp_ns} ns the recording has a message on {recorded.topic!r}, the engine one on {topic!r}"
        )
    difference = first_difference(SCHEMAS[topic].FromString(recorded.raw), again, tolerance)
    if difference:
        raise ReplayMismatch(f"{topic} at {recorded.stamp_ns} ns: {difference}")
