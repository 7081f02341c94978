"""`viewsep replay` with other methods, several recordings, and recordings of several files."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from golden_recording import TRUTH, USED, golden, until_look, with_metadata, write
from shell import Shell

from viewsep.cli.what_if import Method, methods_of
from viewsep.config import RecordingConfig
from viewsep.learning import learn_object
from viewsep.models import library
from viewsep.recording import MODEL_MEDIA_TYPE
from viewsep.recordings.reader import read_recording
from viewsep.recordings.replay import restore
from viewsep.recordings.writer import Attachment, Recorder

FOLDER = Path(__file__).parents[1] / "golden"
GOLDEN = FOLDER / "v1.mcap"
CANDIDATES = ["product_7", TRUTH]
COSTS = {"outcome", "object", "indistinct", "right", "reason", "looks", "travel_deg", "comparisons"}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Sequence[Path]:
    """The golden recording without pictures, one of an unknown object, and one that ends early."""
    folder = tmp_path_factory.mktemp("what_if")
    whole = write(golden(), folder / "whole.mcap")
    unknown = write(with_metadata(golden(), "task", truth=""), folder / "unknown.mcap")
    return [whole, unknown, write(until_look(golden(), 12), folder / "short.mcap")]


def test_it_prints_a_line_a_recording_and_a_line_a_method(files: Sequence[Path], shell: Shell) -> None:
    said = shell("replay", *files, "--interpreter", "path", "--interpreter", "path:variant=initial")
    assert (said.code, said.err) == (0, "")
    lines = [line.split() for line in said.out.splitlines()]
    costs = ["33", "162", "1,774"]
    assert next(line for line in lines if line[:1] == ["whole.mcap"]) == [
        *("whole.mcap", TRUTH, "right", *costs, "right", *costs, "12", "yes")
    ]
    assert next(line for line in lines if line[:1] == ["unknown.mcap"]) == [
        *("unknown.mcap", TRUTH, *costs, TRUTH, *costs, "12", "yes")
    ]
    assert sum(line[:1] == ["short.mcap"] for line in lines) == 2
    summary = lines[next(i for i, line in enumerate(lines) if line[:1] == ["method"]) :]
    assert [line[:6] for line in summary if line[:1] in (["recorded"], ["path"])] == [
        ["recorded", "1", "0", "1", "0", "1"],
        ["path", "1", "0", "1", "0", "1"],
    ]


def test_json_has_all_of_it(files: Sequence[Path], shell: Shell) -> None:
    said = shell("replay", *files, "--interpreter", "path", "--planner", "off", "--planner", "separating", "--json")
    assert said.code == 0
    found = said.json
    assert found["methods"] == ["recorded", "path, planner off", "path, planner separating"]
    assert [row["recording"] for row in found["recordings"]] == [str(file) for file in files]
    assert [row["truth"] for row in found["recordings"]] == [TRUTH, None, TRUTH]
    recorded, off, same = found["recordings"][0]["courses"]
    assert set(recorded) == {*COSTS, "method", "leading", "leads_since", "agrees"}
    assert {key: same[key] for key in COSTS - {"travel_deg"}} == {key: recorded[key] for key in COSTS - {"travel_deg"}}
    assert (off["outcome"], off["object"], off["right"], off["agrees"]) == ("identified", TRUTH, True, True)
    assert [course["right"] for course in found["recordings"][1]["courses"]] == [None, None, None]
    assert [course["outcome"] for course in found["recordings"][2]["courses"]] == ["recording ends"] * 3
    summary = found["summary"][0]
    assert (summary["method"], summary["right"], summary["unchecked"], summary["recording_ends"]) == (
        "recorded",
        1,
        1,
        1,
    )


def test_the_same_command_prints_the_same(files: Sequence[Path], shell: Shell) -> None:
    first, second = (shell("replay", files[2], "--interpreter", "path:alignment=wahba") for _ in range(2))
    assert first == second
    assert "short.mcap" in first.out


def test_models_learned_anew_take_the_place_of_the_recorded_ones(
    files: Sequence[Path], shell: Shell, tmp_path: Path
) -> None:
    for model in restore(golden())[1]:
        features = np.roll(model.features, 1, axis=0) if model.name == TRUTH else model.features
        library.save(replace(model, features=features), tmp_path / "library")
    typed: list[str | Path] = [files[0], "--interpreter", "path", "--models", tmp_path / "library", "--json"]
    recorded, other = shell("replay", *typed).json["recordings"][0]["courses"]
    assert (recorded["object"], recorded["agrees"]) == (TRUTH, True)
    assert other["comparisons"] != recorded["comparisons"]
    assert other["object"] != TRUTH
    checked = shell("replay", files[0], "--models", tmp_path / "library")
    assert checked.code == 2
    assert "but the library has" in checked.err


@pytest.mark.needs_pybullet
def test_another_descriptor_needs_models_learned_with_it(shell: Shell, tmp_path: Path) -> None:
    config, _ = restore(golden())
    other = config.model_copy(
        update={"descriptor": config.descriptor.model_copy(update={"options": {"distance_px": 2}})}
    )
    for name, source in zip(CANDIDATES, ("generated:7", "generated:7:twin=face"), strict=True):
        library.save(learn_object(source, name, 60, other), tmp_path / "library")
    typed = ("replay", GOLDEN, "--models", tmp_path / "library")
    said = shell(*typed, "--descriptor", "cch:distance_px=2", "--json")
    assert said.code == 0, said.err
    assert said.json["methods"] == ["recorded", "descriptor cch:distance_px=2"]
    recorded, found = said.json["recordings"][0]["courses"]
    assert found["comparisons"] != recorded["comparisons"]
    assert found["looks"] > 0
    unfit = shell(*typed, "--descriptor", "cch:distance_px=3")
    assert (unfit.code, unfit.out) == (2, "")
    assert "not with cch {'distance_px': 3, 'gradient_step': 6} as --descriptor says: learn it again" in unfit.err
    without = shell(*typed, "--interpreter", "path")
    assert (without.code, without.out) == (2, "")
    assert "give --descriptor, so that percepts are made anew of the pictures" in without.err


TWO_THINGS = "check what was recorded, --interpreter, --planner and --descriptor try"


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        (["--verify", "--interpreter", "path"], TWO_THINGS),
        (
            ["--interpreter", "path:variant=x"],
            "--interpreter 'path:variant=x': interpreter.options, key 'variant' = 'x'",
        ),
        (["--planner", "on"], "--planner 'on': no planner is called 'on': choose one of .*off, "),
        (["--planner", "off", "--planner", "off"], "--planner off is given twice: give it once"),
        (["--descriptor", "cch:distance_px=9"], "'product_7' was learned with descriptor cch {.*give --models LIBRARY"),
        (["--descriptor", "cch"], "whole.mcap: the recording holds no pictures, and another descriptor"),
        (["--planner", "off", "--models", "nowhere"], "whole.mcap: no library at nowhere"),
        ([], "nothing to do: give --verify, .* --interpreter, --planner or --descriptor to try something else"),
    ],
)
def test_bad_options_are_one_sentence(typed: list[str], words: str, files: Sequence[Path], shell: Shell) -> None:
    said = shell("replay", files[0], *typed)
    assert (said.code, said.out) == (2, "")
    assert len(said.err.splitlines()) == 1
    assert re.search(words, said.err), said.err


@pytest.mark.parametrize("options", [["--planner", "off"], ["--verify"]])
def test_a_file_that_cannot_be_read_is_named(
    options: list[str], files: Sequence[Path], shell: Shell, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(files[0].read_bytes()[:-100])
    for bad in (broken, tmp_path / "nowhere.mcap", tmp_path):
        said = shell("replay", files[0], bad, *options)
        assert (said.code, said.out) == (2, "")  # nothing is made of the first before the last is known to be sound
        assert said.err.startswith(f"viewsep: {bad}: ")
        assert len(said.err.splitlines()) == 1
    headless = write(with_metadata(golden(), "config", json="{"), tmp_path / "headless.mcap")
    said = shell("replay", files[0], headless, *options)
    assert said.code == 2
    assert f"{headless}: the recording's configuration cannot be used" in said.err


# several files


@pytest.fixture(scope="module")
def parts(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """The golden recording of layout 2 in several files, as a recorder leaves it that begins a new one now and then."""
    whole = read_recording(FOLDER / "v2.mcap")
    attached = [Attachment(name, MODEL_MEDIA_TYPE, data) for name, data in whole.attachments.items()]
    settings = RecordingConfig(rotate_s=1e-9)
    with Recorder(tmp_path_factory.mktemp("parts") / "run.mcap", whole.metadata, attached, settings=settings) as made:
        for row in whole.messages:
            made.hear(row.stamp_ns, row.message)
    assert len(made.paths) > 2
    return made.paths


def test_the_files_of_one_recording_are_one(parts: list[Path], files: Sequence[Path], shell: Shell) -> None:
    said = shell("replay", files[0], *parts, "--interpreter", "path", "--json").json["recordings"]
    assert [row["files"] for row in said] == [[str(files[0])], [str(part) for part in parts]]
    assert [row["courses"][1]["looks"] for row in said] == [USED, USED]
    assert [row["gaps"] for row in said] == [0, 0]
    verified = shell("replay", *parts, "--verify", "--json").json
    assert verified["recording"] == ", ".join(str(part) for part in parts)
    assert verified["decisions"]["skipped"] == 0
    both = shell("replay", *parts, files[0], "--verify", "--json").json
    assert [row["decisions"]["outputs"] for row in both] == [verified["decisions"]["outputs"]] * 2
    assert f"run.mcap +{len(parts) - 1}" in shell("replay", *parts, "--planner", "off").out


def test_a_missing_file_of_a_recording_is_a_gap(parts: list[Path], shell: Shell) -> None:
    said = shell("replay", parts[0], *parts[2:], "--planner", "off")
    assert said.code == 0
    assert "messages are missing in one place" in said.out
    first = shell("replay", *parts[1:], "--planner", "off")
    assert first.code == 2
    assert "the beginning of the task is not in the recording" in first.err


def test_files_that_cannot_be_put_together_are_refused(
    parts: list[Path], files: Sequence[Path], shell: Shell, tmp_path: Path
) -> None:
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(parts[0].read_bytes())
    twice = shell("replay", parts[0], copy, "--planner", "off")
    assert (twice.code, twice.out) == (2, "")
    assert f"{copy} and {parts[0]} are the same part of one recording: give one of them" in twice.err
    apart = shell("replay", parts[0], files[0], parts[1], "--planner", "off")
    assert (apart.code, apart.out) == (2, "")
    assert f"{parts[1]} is a part of the same recording as {parts[0]}: give its files in a row" in apart.err


def test_method_names_say_what_was_asked_for() -> None:
    names = [method.name for method in methods_of(["path", "path:variant=initial"], ["off"], "cch")]
    assert names == ["path, planner off, descriptor cch", "path:variant=initial, planner off, descriptor cch"]
    assert methods_of([], [], "cch")[0] == Method("descriptor cch", None, None, methods_of([], [], "cch")[0].descriptor)
