"""Record A = record B = replay A, byte for byte; whatever was altered afterwards is found and named."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from seed_method import seed_config

from viewsep.config import Config, InterpreterConfig, PlannerConfig
from viewsep.errors import BadRecording, ReplayMismatch
from viewsep.learning import learn_object
from viewsep.messages import (
    Command,
    Estimate,
    Frame,
    Keyframe,
    Message,
    MoveSettled,
    Outcome,
    PerceptReceived,
    Result,
    Stop,
)
from viewsep.models import library
from viewsep.models.aspect_graph import AspectGraph
from viewsep.plugins import names
from viewsep.recording import MODEL_MEDIA_TYPE
from viewsep.recordings.build import this_build
from viewsep.recordings.reader import Recording, read_recording
from viewsep.recordings.replay import replay, restore, start_at, use_models, verify, verify_frames
from viewsep.recordings.writer import Attachment, Recorder
from viewsep.task import Task, run_task

pytestmark = pytest.mark.needs_pybullet

SEED = 3
SOURCES = {"tea": "generated:5", "decaf": "generated:5:twin=face"}
CAMERA = {"size_px": 64}  # small pictures: what is tested is the same, and quick
OTHER_BUILD = {**this_build(), "processor": "abacus"}
Heard = list[tuple[int, Message]]
Change = Callable[[Heard], None]

DISTURBED = {
    "light": 0.3,
    "noise": 0.02,
    "blur_px": 1.0,
    "mask_error": 0.05,
    "backlash_deg": 1.0,
    "encoder_noise_deg": 0.2,
    "latency_s": 0.05,
    "drop_rate": 0.1,
    "slip_deg": 20.0,
}


def settings(looks: int = 25, sim: Mapping[str, float] | None = None, **interpreter: str) -> Config:
    """The seed's method: its tasks have many looks."""
    return seed_config(
        camera=CAMERA, task={"max_looks": looks}, sim=dict(sim or {}), interpreter={"options": interpreter}
    )


@pytest.fixture(scope="module")
def models() -> list[AspectGraph]:
    return [learn_object(source, name, 48, settings()) for name, source in SOURCES.items()]


def recorded(path: Path, config: Config, models: list[AspectGraph], seed: int = SEED) -> Recording:
    run_task(Task(SOURCES["tea"], "tea", seed, path), config, models)
    return read_recording(path)


@pytest.fixture(scope="module")
def original(models: list[AspectGraph], tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return recorded(tmp_path_factory.mktemp("original") / "a.mcap", settings(), models)


def heard(recording: Recording) -> Heard:
    """The recorded pictures and messages, every picture before the percept that was made from it."""
    frames = {frame.stamp_ns: frame.decode() for frame in recording.frames}
    messages: Heard = []
    for recorded in recording.messages:
        if isinstance(recorded.message, PerceptReceived) and recorded.message.stamp_ns in frames:
            messages.append((recorded.stamp_ns, frames[recorded.message.stamp_ns]))
        messages.append((recorded.stamp_ns, recorded.message))
    return messages


def rewritten(
    recording: Recording,
    path: Path,
    change: Change = lambda _: None,
    build: Mapping[str, str] | None = None,
    pictures: bool = False,
) -> Recording:
    """The recording with changed messages, written and read again; without pictures unless they matter."""
    if not pictures:
        recording = replace(recording, frames=())
    messages = heard(recording)
    change(messages)
    metadata = {**recording.metadata, "build": dict(build or recording.metadata["build"])}
    attachments = [Attachment(name, MODEL_MEDIA_TYPE, data) for name, data in recording.attachments.items()]
    with Recorder(path, metadata, attachments) as recorder:
        for stamp_ns, message in messages:
            recorder.hear(stamp_ns, message)
    return read_recording(path)


def where(messages: Heard, kind: type) -> list[int]:
    return [index for index, (_, message) in enumerate(messages) if isinstance(message, kind)]


def raws(recording: Recording) -> list[tuple[str, int, bytes]]:
    return [(r.topic, r.stamp_ns, r.raw) for r in recording.messages]


def alter_travel(factor: float) -> Change:
    def change(messages: Heard) -> None:
        index = where(messages, Estimate)[10]
        stamp_ns, estimate = messages[index]
        assert isinstance(estimate, Estimate)
        assert estimate.travel_rad > 0
        messages[index] = stamp_ns, replace(estimate, travel_rad=estimate.travel_rad * factor)

    return change


@pytest.mark.parametrize(
    ("variant", "alignment"),
    [
        ("initial", "fig4"),
        ("particles", "fig4"),
        ("loop_free", "fig4"),
        ("accumulated", "fig4"),
        pytest.param("initial", "wahba", marks=pytest.mark.long),
        pytest.param("particles", "wahba", marks=pytest.mark.long),
        pytest.param("loop_free", "wahba", marks=pytest.mark.long),
        ("accumulated", "wahba"),
    ],
)
def test_two_runs_and_a_replay_are_the_same_bytes(
    variant: str, alignment: str, models: list[AspectGraph], tmp_path: Path
) -> None:
    config = settings(20, variant=variant, alignment=alignment)
    a, b = (recorded(tmp_path / name, config, models) for name in ("a.mcap", "b.mcap"))
    assert raws(a) == raws(b)
    found = verify(a)
    assert found.exact
    assert found.outputs == sum(isinstance(r.message, Estimate | Command | Result) for r in a.messages)
    assert found.outputs > 15


@pytest.mark.parametrize("name", [name for name in names("interpreter") if name != "path"])
def test_so_do_runs_of_every_other_interpreter(name: str, models: list[AspectGraph], tmp_path: Path) -> None:
    config = settings(20).model_copy(update={"interpreter": InterpreterConfig(name=name), "planner": PlannerConfig()})
    a, b = (recorded(tmp_path / file, config, models) for file in ("a.mcap", "b.mcap"))
    assert raws(a) == raws(b)
    found = verify(a)
    assert found.exact
    assert found.outputs > 10
    keyframes = [recorded.stamp_ns for recorded in a.messages if isinstance(recorded.message, Keyframe)]
    assert verify(start_at(a, keyframes[-1])).exact


def test_disturbed_runs_repeat_too(models: list[AspectGraph], tmp_path: Path) -> None:
    config = settings(30, DISTURBED)
    a, b = (recorded(tmp_path / name, config, models) for name in ("a.mcap", "b.mcap"))
    assert raws(a) == raws(b)
    assert verify(a).exact
    assert verify_frames(a).percepts > 20


def test_another_seed_is_another_run(original: Recording, models: list[AspectGraph], tmp_path: Path) -> None:
    assert raws(recorded(tmp_path / "b.mcap", settings(), models, SEED + 1)) != raws(original)


def test_a_recording_carries_what_a_replay_needs(original: Recording, models: list[AspectGraph]) -> None:
    config, restored = restore(original)
    assert config == settings()
    assert [model.digest for model in restored] == [model.digest for model in models]
    use_models(original, models)
    assert json.loads(original.metadata["task"]["candidates"]) == ["tea", "decaf"]
    assert original.metadata["build"] == this_build()


def test_rewriting_alone_changes_nothing(original: Recording, tmp_path: Path) -> None:
    again = rewritten(original, tmp_path / "b.mcap")
    assert raws(again) == raws(original)
    assert verify(again).exact


def test_replay_ends_with_the_recorded_result(original: Recording) -> None:
    steps = list(replay(original))
    result = steps[-1].state.result
    assert result is not None
    assert steps[-1].outputs[-1] is result
    assert all(step.state.result is None for step in steps[:-1])


def test_an_altered_estimate_is_named(original: Recording, tmp_path: Path) -> None:
    changed = rewritten(original, tmp_path / "b.mcap", alter_travel(1 + 1e-12))
    index = where(heard(changed), Estimate)[10]
    stamp_ns, said = heard(changed)[index]
    now = next(message for stamp, message in heard(original) if stamp == stamp_ns and isinstance(message, Estimate))
    assert isinstance(said, Estimate)
    with pytest.raises(ReplayMismatch) as mismatch:
        verify(changed)
    expected = f"estimate at {stamp_ns} ns: field 'travel_rad': {said.travel_rad!r} recorded, {now.travel_rad!r} now"
    assert str(mismatch.value) == expected


def test_an_altered_candidate_is_named(original: Recording, tmp_path: Path) -> None:
    def change(messages: Heard) -> None:
        stamp_ns, estimate = messages[where(messages, Estimate)[5]]
        assert isinstance(estimate, Estimate)
        first, second = estimate.candidates
        rotation = second.rotation.copy()
        rotation[1, 2] += 1e-9
        estimate = replace(estimate, candidates=(first, replace(second, rotation=rotation)))
        messages[where(messages, Estimate)[5]] = stamp_ns, estimate

    changed = rewritten(original, tmp_path / "b.mcap", change)
    with pytest.raises(ReplayMismatch, match=r"estimate at \d+ ns: in 'candidates\[1\]', field 'rotation\[5\]': -?\d"):
        verify(changed)


def test_an_altered_result_is_named(original: Recording, tmp_path: Path) -> None:
    def change(messages: Heard) -> None:
        stamp_ns, result = messages[where(messages, Result)[0]]
        assert isinstance(result, Result)
        other = Outcome.FAILED if result.outcome is not Outcome.FAILED else Outcome.UNDECIDED
        messages[where(messages, Result)[0]] = stamp_ns, replace(result, outcome=other)

    changed = rewritten(original, tmp_path / "b.mcap", change)
    with pytest.raises(ReplayMismatch, match=r"result at \d+ ns: field 'outcome': 'failed' recorded, '\w+' now"):
        verify(changed)


def used_percepts(messages: Heard) -> list[int]:
    """Those that were new evidence: the engine ignores the ones it has not turned far enough for."""
    return [index for index in where(messages, PerceptReceived) if isinstance(messages[index + 1][1], Estimate)]


def drop_percept(messages: Heard) -> None:
    del messages[used_percepts(messages)[3]]


def drop(kind: type, number: int) -> Change:
    def change(messages: Heard) -> None:
        del messages[where(messages, kind)[number]]

    return change


def exchange_percepts(messages: Heard) -> None:
    a, b = used_percepts(messages)[3:5]
    messages[a], messages[b] = messages[b], messages[a]


def add_output(messages: Heard) -> None:
    messages.append((messages[-1][0], Stop(99, "for no reason")))


def other_command(messages: Heard) -> None:
    index = where(messages, Estimate)[4]
    messages[index] = messages[index][0], Stop(99, "for no reason")


ALTERED: dict[str, tuple[Change, str]] = {
    "percept removed": (drop_percept, r"at \d+ ns"),
    "arrival removed": (drop(MoveSettled, 1), r"at \d+ ns"),
    "percepts exchanged": (exchange_percepts, r"estimate at \d+ ns: field"),
    "estimate removed": (drop(Estimate, 6), r"at \d+ ns"),
    "result removed": (drop(Result, 0), "put out result at the end of the recording, which the recording lacks"),
    "output added": (add_output, r"has command at \d+ ns, which the engine did not put out"),
    "output of another topic": (other_command, r"ns the recording has a message on 'command', the engine one on 'est"),
}


@pytest.mark.parametrize(("change", "words"), ALTERED.values(), ids=ALTERED.keys())
def test_other_messages_are_a_mismatch_even_of_another_build(
    change: Change, words: str, original: Recording, tmp_path: Path
) -> None:
    with pytest.raises(ReplayMismatch, match=words):
        verify(rewritten(original, tmp_path / "b.mcap", change, OTHER_BUILD))


def test_another_build_may_differ_in_the_last_digits(original: Recording, tmp_path: Path) -> None:
    found = verify(rewritten(original, tmp_path / "b.mcap", alter_travel(1 + 1e-9), OTHER_BUILD))
    assert not found.exact


def test_another_build_may_not_differ_visibly(original: Recording, tmp_path: Path) -> None:
    changed = rewritten(original, tmp_path / "b.mcap", alter_travel(1 + 1e-3), OTHER_BUILD)
    with pytest.raises(ReplayMismatch, match="field 'travel_rad'"):
        verify(changed)


def test_equal_bytes_of_another_build_are_exact(original: Recording, tmp_path: Path) -> None:
    assert verify(rewritten(original, tmp_path / "b.mcap", build=OTHER_BUILD)).exact


def test_models_of_another_run_are_refused(original: Recording, models: list[AspectGraph], tmp_path: Path) -> None:
    other = replace(models[0], features=models[1].features)
    attachments = {**original.attachments, f"tea{library.SUFFIX}": library.to_bytes(other)}
    mixed = replace(original, attachments=attachments)
    with pytest.raises(BadRecording, match=rf"model tea {models[0].digest[:12]}, but holds {other.digest[:12]}"):
        verify(mixed)
    with pytest.raises(BadRecording, match=rf"model tea {models[0].digest[:12]}, but the library has"):
        use_models(original, [other])


@pytest.mark.parametrize("name", ["config", "models", "task"])
def test_a_recording_of_something_else_is_refused(name: str, original: Recording) -> None:
    metadata = {key: value for key, value in original.metadata.items() if key != name}
    with pytest.raises(BadRecording, match=f"lacks '{name}'"):
        verify(replace(original, metadata=metadata))


def test_a_recording_without_its_models_is_refused(original: Recording) -> None:
    with pytest.raises(BadRecording, match=r"lacks 'tea\.viewsep'"):
        verify(replace(original, attachments={}))


@pytest.mark.parametrize("text", ["{", '{"rig": {"preset": "arm"}}', "[]", '{"unheard_of": 1}'])
def test_a_recorded_configuration_of_another_version_is_refused(text: str, original: Recording) -> None:
    with pytest.raises(BadRecording, match="configuration cannot be used by this viewsep"):
        verify(replace(original, metadata={**original.metadata, "config": {"json": text}}))


def test_percepts_come_from_the_recorded_pictures(original: Recording) -> None:
    found = verify_frames(original)
    assert found.percepts == sum(isinstance(r.message, PerceptReceived) for r in original.messages)
    assert 0.85 < found.similarity_min <= found.similarity_median <= 1.0


def change_frames(edit: Callable[[Frame], Frame]) -> Change:
    def change(messages: Heard) -> None:
        for index in where(messages, Frame):
            stamp_ns, frame = messages[index]
            assert isinstance(frame, Frame)
            messages[index] = stamp_ns, edit(frame)

    return change


def exchange_pictures(messages: Heard) -> None:
    """Every frame gets the picture of the one half a recording later."""
    places = where(messages, Frame)
    frames: Iterable[Message] = [messages[index][1] for index in places]
    pictures = [(frame.image, frame.mask) for frame in frames if isinstance(frame, Frame)]
    shift = len(pictures) // 2
    for index, (image, mask) in zip(places, pictures[shift:] + pictures[:shift], strict=True):
        stamp_ns, frame = messages[index]
        assert isinstance(frame, Frame)
        messages[index] = stamp_ns, replace(frame, image=image, mask=mask)


def test_exchanged_pictures_are_found(original: Recording, tmp_path: Path) -> None:
    with pytest.raises(ReplayMismatch, match=r"percept at \d+ ns: feature from the picture is only 0\.\d+ similar"):
        verify_frames(rewritten(original, tmp_path / "b.mcap", exchange_pictures, pictures=True))


def test_pictures_of_other_colours_are_found(original: Recording, tmp_path: Path) -> None:
    swapped = change_frames(lambda frame: replace(frame, image=np.ascontiguousarray(frame.image[..., ::-1])))
    with pytest.raises(ReplayMismatch, match="feature from the picture"):
        verify_frames(rewritten(original, tmp_path / "b.mcap", swapped, pictures=True))


def test_a_missing_picture_is_found(original: Recording, tmp_path: Path) -> None:
    with pytest.raises(BadRecording, match=r"the picture of the percept at \d+ ns is not in the recording"):
        verify_frames(rewritten(original, tmp_path / "b.mcap", drop(Frame, 4), pictures=True))


def test_an_altered_view_direction_is_found(original: Recording, tmp_path: Path) -> None:
    def change(messages: Heard) -> None:
        index = where(messages, PerceptReceived)[3]
        stamp_ns, event = messages[index]
        assert isinstance(event, PerceptReceived)
        turned = event.percept.view_direction + np.array([0.0, 1e-6, 1e-6])
        percept = replace(event.percept, view_direction=turned / np.linalg.norm(turned))
        messages[index] = stamp_ns, PerceptReceived(percept)

    with pytest.raises(ReplayMismatch, match=r"percept at \d+ ns: view direction differs by .* deg \(tolerance"):
        verify_frames(rewritten(original, tmp_path / "b.mcap", change, pictures=True))
