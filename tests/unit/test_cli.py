"""The command line from learning to the picture: what it prints where, what it writes, and how it exits."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from seed_method import SEED_OPTIONS
from shell import Shell

from viewsep import __version__
from viewsep.built_rig import PictureKind
from viewsep.cli import main
from viewsep.cli.separate import exit_code, tell
from viewsep.config import Config, PluginConfig, geometry_of, load_config
from viewsep.interpretation.filter_state import FilterOptions
from viewsep.messages import CancelRequested, Outcome, Result
from viewsep.models.library import load_library, save
from viewsep.planning.information import InformationOptions
from viewsep.planning.reachable import ReachableViews
from viewsep.plugins import make_descriptor, make_interpreter, make_planner
from viewsep.recordings.reader import read_recording
from viewsep.recordings.replay import verify
from viewsep.session import Session
from viewsep.task import Answer, Task, run_task

CONFIGS = Path(__file__).parents[2] / "docs" / "config"
PRESETS = ["gimbal", "pan_tilt", "turntable", "wrist"]
VIEWS = 60
NAMES = ["product_5", "product_5_twin_face"]
PNG = b"\x89PNG\r\n\x1a\n"
ANSWER_KEYS = {
    "outcome",
    "object",
    "indistinct",
    "telling_view_deg",
    "reason",
    "truth",
    "correct",
    "ratings",
    "pose_quaternion_xyzw",
    "pose_spread_deg",
    "pose_error_deg",
    "looks",
    "travel_deg",
    "comparisons",
    "seed",
    "simulated",
    "pictures",
    "rig",
    "recording",
}


@pytest.fixture(scope="module")
def lib(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cli") / "library"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            sys,
            "argv",
            ["viewsep", "learn", "generated:5", "generated:5:twin=face", "-o", str(folder), "--views", str(VIEWS)],
        )
        with pytest.raises(SystemExit) as end:
            main()
    assert end.value.code == 0
    return folder


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A configuration that gives up early."""
    path = tmp_path_factory.mktemp("config") / "short.toml"
    path.write_text("[task]\nmax_looks = 6\n")
    return path


def test_the_version_is_printed(shell: Shell) -> None:
    ended = shell("--version")
    assert (ended.code, ended.out, ended.err) == (0, f"viewsep {__version__}\n", "")


def test_the_module_runs_as_the_command_does(tmp_path: Path) -> None:
    run = subprocess.run(
        [sys.executable, "-m", "viewsep", "--version"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stdout, run.stderr) == (0, f"viewsep {__version__}\n", "")


@pytest.mark.parametrize(
    "command",
    ["demo", "learn", "models", "separate", "replay", "report", "bench speed", "bench separation"],
)
def test_every_command_shows_an_example(command: str, shell: Shell) -> None:
    ended = shell(*command.split(), "--help")
    assert ended.code == 0
    assert "Example" in ended.out
    assert ended.out.count(f"viewsep {command}") >= 2  # usage and example


def test_help_names_every_command(shell: Shell) -> None:
    ended = shell("-h")
    for command in ("demo", "learn", "models", "separate", "replay", "report", "bench"):
        assert f" {command} " in ended.out


@pytest.mark.needs_pybullet
def test_learn_says_what_it_wrote(shell: Shell, tmp_path: Path) -> None:
    ended = shell("learn", "generated:3", "--name", "tea", "--views", "12", "-o", tmp_path / "new" / "lib")
    path = tmp_path / "new" / "lib" / "tea.viewsep"
    assert ended.code == 0
    assert ended.out == f"learned tea: 12 views -> {path}\n"
    assert path.is_file()


@pytest.mark.needs_pybullet
def test_learn_prints_json(shell: Shell, tmp_path: Path) -> None:
    ended = shell("learn", "generated:3", "--views", "12", "-o", tmp_path, "--json")
    (entry,) = ended.json
    (model,) = load_library(tmp_path)
    assert entry == {
        "name": "product_3",
        "views": 12,
        "file": str(tmp_path / "product_3.viewsep"),
        "hash": model.digest,
    }
    assert (ended.code, ended.err) == (0, "")


@pytest.mark.needs_pybullet
def test_learning_again_gives_the_same_bytes(shell: Shell, tmp_path: Path) -> None:
    for folder in ("a", "b"):
        assert shell("learn", "generated:3", "--views", "12", "-o", tmp_path / folder).code == 0
    a, b = ((tmp_path / folder / "product_3.viewsep").read_bytes() for folder in ("a", "b"))
    assert a == b


@pytest.mark.needs_pybullet
def test_models_lists_and_draws(shell: Shell, lib: Path, tmp_path: Path) -> None:
    ended = shell("models", lib, "--plot", tmp_path / "sheet.png", "--json")
    assert ended.code == 0
    assert [row["name"] for row in ended.json] == NAMES
    first = ended.json[0]
    assert set(first) == {
        *("name", "views", "edges", "bytes", "descriptor"),
        *("descriptor_parameters", "feature_values", "source", "hash"),
    }
    values = VIEWS * make_descriptor(Config().descriptor).size
    assert (first["views"], first["feature_values"], first["edges"]) == (VIEWS, values, 3 * VIEWS - 6)
    assert first["source"] == "generated:5"
    assert first["bytes"] == (lib / "product_5.viewsep").stat().st_size
    assert (tmp_path / "sheet.png").read_bytes().startswith(PNG)
    table = shell("models", lib)
    assert table.code == 0
    assert all(name in table.out for name in NAMES)


@pytest.mark.needs_pybullet
def test_separate_answers_in_json_on_stdout_alone(shell: Shell, lib: Path) -> None:
    ended = shell("separate", "--models", lib, "--truth", NAMES[0], "--json")
    answer = ended.json
    assert set(answer) == ANSWER_KEYS
    assert ended.err == ""
    assert answer["truth"] == NAMES[0]
    assert list(answer["ratings"]) == NAMES
    assert answer["recording"] is None
    assert answer["simulated"] is True
    assert np.linalg.norm(answer["pose_quaternion_xyzw"]) == pytest.approx(1.0)
    assert 0 <= answer["pose_error_deg"] <= 180
    assert answer["correct"] is (None if answer["object"] is None else answer["object"] == NAMES[0])
    expected = {"identified": 0 if answer["correct"] else 5, "undecided": 3, "failed": 4}
    assert ended.code == expected[answer["outcome"]]


@pytest.mark.needs_pybullet
def test_separate_tells_people(shell: Shell, lib: Path, short: Path) -> None:
    ended = shell("separate", "--models", lib, "--truth", NAMES[0], "--config", short)
    assert "looks, " in ended.out
    assert "(simulated rig)" in ended.out


@pytest.mark.needs_pybullet
def test_too_few_looks_end_undecided(shell: Shell, lib: Path, short: Path) -> None:
    ended = shell("separate", "--models", lib, "--truth", NAMES[0], "--config", short, "--json")
    assert ended.code == 3
    assert (ended.json["outcome"], ended.json["object"], ended.json["correct"]) == ("undecided", None, None)
    assert ended.json["looks"] == 6


@pytest.mark.needs_pybullet
def test_an_object_that_is_no_candidate_has_no_truth(shell: Shell, lib: Path, short: Path) -> None:
    ended = shell("separate", "--models", lib, "--object", "generated:9", "--config", short, "--json")
    assert (ended.json["truth"], ended.json["correct"], ended.json["pose_error_deg"]) == (None, None, None)
    assert ended.code == 3


@pytest.mark.needs_pybullet
def test_a_posterior_knows_its_pose_and_the_tolerance_asks_for_it(shell: Shell, lib: Path) -> None:
    typed: list[str | Path] = ["separate", "--models", lib, "--truth", NAMES[0]]
    named = shell(*typed, "--json")
    tolerance = 0.85 * named.json["pose_spread_deg"]
    known = shell(*typed, "--pose-tolerance", f"{tolerance}", "--json")
    assert (named.code, known.code) == (0, 0)
    assert known.json["pose_spread_deg"] <= tolerance
    assert known.json["looks"] > named.json["looks"]
    assert "comparisons, pose known to ±" in shell(*typed).out


@pytest.mark.needs_pybullet
def test_paths_do_not_know_how_well_they_know_the_pose(shell: Shell, lib: Path, short: Path) -> None:
    typed: list[str | Path] = ["separate", "--models", lib, "--truth", NAMES[0], "--config", short, *SEED_OPTIONS]
    ended = shell(*typed, "--pose-tolerance", 5, "--json")
    assert "note: interpreter path does not know how well the pose is known" in " ".join(ended.err.split())
    assert (ended.code, ended.json["pose_spread_deg"]) == (3, None)
    assert shell(*typed, "--json").err == ""


@pytest.mark.needs_pybullet
def test_a_planner_is_chosen_by_its_name(shell: Shell, lib: Path, short: Path, tmp_path: Path) -> None:
    typed: list[str | Path] = ["separate", "--models", lib, "--truth", NAMES[0], "--config", short]
    shell(*typed, "--planner", "random", "--record", tmp_path / "run.mcap")
    recorded = json.loads(read_recording(tmp_path / "run.mcap").metadata["config"]["json"])
    assert recorded["planner"] == {"name": "random", "options": {}}
    ended = shell(*typed, "--planner", "clairvoyant")
    assert ended.code == 2
    assert "no planner is called 'clairvoyant': choose one of" in " ".join(ended.err.split())


def told(outcome: Outcome, truth: str, correct: bool | None, **more: Any) -> Answer:
    result = Result(9, outcome, more.pop("named", ""), "why", (), np.eye(3), 3, 0.1, 9, **more)
    return Answer(Task("generated:5", truth, 0), result, correct, np.nan, PictureKind.RENDERED, "simulated rig")


ANSWERS = {
    "right name": (told(Outcome.IDENTIFIED, "tea", True, named="tea"), 0, "It is tea (right): why."),
    "wrong name": (told(Outcome.IDENTIFIED, "decaf", False, named="tea"), 5, "It is tea (wrong: it is decaf): why."),
    "name, no truth": (told(Outcome.IDENTIFIED, "", False, named="tea"), 0, "It is tea: why."),
    "unknown, right": (told(Outcome.UNKNOWN, "", True), 6, "It is none of the candidates (right): why."),
    "unknown, wrong": (
        told(Outcome.UNKNOWN, "tea", False),
        5,
        "It is none of the candidates (wrong: it is tea): why.",
    ),
    "unknown, learned": (
        told(Outcome.UNKNOWN, "", False),
        5,
        "It is none of the candidates (wrong: it is one of them): why.",
    ),
    "twins": (
        told(Outcome.INDISTINGUISHABLE, "tea", True, indistinct=("tea", "decaf"), telling_view=np.array([0, 1.0, 0])),
        7,
        "It is tea or decaf (right): why; azimuth 90°, elevation 0° would, which it cannot reach.",
    ),
    "other twins": (
        told(Outcome.INDISTINGUISHABLE, "mate", False, indistinct=("tea", "decaf")),
        5,
        "It is tea or decaf (wrong: it is mate): why.",
    ),
    "undecided": (told(Outcome.UNDECIDED, "tea", None), 3, "undecided: why."),
    "failed": (told(Outcome.FAILED, "tea", None), 4, "failed: why."),
}


@pytest.mark.parametrize("ending", ANSWERS)
def test_every_answer_has_its_sentence_and_exit_code(ending: str, capsys: pytest.CaptureFixture[str]) -> None:
    answer, code, sentence = ANSWERS[ending]
    tell(answer)
    assert capsys.readouterr().out.splitlines()[0] == sentence
    assert exit_code(answer) == code


@pytest.mark.needs_pybullet
@pytest.mark.parametrize(
    ("truth", "source", "correct", "code"),
    [(NAMES[0], "generated:5", False, 5), ("", "generated:5", False, 5), ("", "generated:9", True, 6)],
)
def test_unknown_is_right_of_what_no_candidate_was_learned_from(
    truth: str, source: str, correct: bool, code: int, lib: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended = Result(9, Outcome.UNKNOWN, "", "why", (), np.eye(3), 3, 0.1, 9)
    monkeypatch.setattr(Session, "run", lambda *_: ended)
    answer = run_task(Task(source, truth, 0), Config(), load_library(lib))
    assert (answer.correct, exit_code(answer)) == (correct, code)


@pytest.mark.needs_pybullet
def test_candidates_keep_their_order(shell: Shell, lib: Path, short: Path) -> None:
    typed: list[str | Path] = [
        "separate",
        "--models",
        lib,
        "--truth",
        NAMES[0],
        "--config",
        short,
        "--json",
        "--candidates",
    ]
    assert list(shell(*typed, f"{NAMES[1]}, {NAMES[0]}").json["ratings"]) == NAMES[::-1]


@pytest.mark.needs_pybullet
def test_the_seed_decides(shell: Shell, lib: Path, short: Path) -> None:
    typed: list[str | Path] = ["separate", "--models", lib, "--truth", NAMES[0], "--config", short, "--json", "--seed"]
    first, again, other = (shell(*typed, seed).out for seed in ("1", "1", "2"))
    assert first == again
    assert json.loads(other)["ratings"] != json.loads(first)["ratings"]


@pytest.mark.needs_pybullet
def test_a_recording_is_verified_and_drawn(shell: Shell, lib: Path, short: Path, tmp_path: Path) -> None:
    run, picture = tmp_path / "run.mcap", tmp_path / "run.png"
    typed: list[str | Path] = [
        "separate",
        "--models",
        lib,
        "--truth",
        NAMES[0],
        "--config",
        short,
        "--record",
        run,
        "--json",
    ]
    first = shell(*typed)
    assert first.json["recording"] == str(run)
    replayed = shell("replay", run, "--verify", "--from-frames", "--models", lib, "--json")
    assert replayed.code == 0
    assert set(replayed.json) == {"recording", "models", "decisions", "frames"}
    assert replayed.json["decisions"]["exact"] is True
    assert replayed.json["decisions"]["outputs"] > 5
    assert replayed.json["frames"]["similarity_min"] > replayed.json["frames"]["tolerance"]
    drawn = shell("report", run, "-o", picture)
    assert (drawn.code, drawn.out) == (0, f"report: {picture}\n")
    assert picture.read_bytes().startswith(PNG)
    assert shell(*typed).code == 2
    assert shell(*typed, "--force").code == first.code
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.mcap", "run.png"]


@pytest.mark.parametrize("name", PRESETS)
def test_the_example_configurations_load(name: str) -> None:
    config = load_config(CONFIGS / f"{name}.toml")
    assert len(geometry_of(config.rig).axes) == {"gimbal": 2, "pan_tilt": 2, "turntable": 1, "wrist": 3}[name]


def test_there_is_an_example_for_every_preset() -> None:
    assert sorted(path.stem for path in CONFIGS.glob("*.toml")) == PRESETS


@pytest.mark.needs_pybullet
def test_the_gimbal_example_shows_the_defaults(lib: Path) -> None:
    shown, default = load_config(CONFIGS / "gimbal.toml"), Config()
    models = load_library(lib)
    descriptors = [make_descriptor(config.descriptor) for config in (shown, default)]
    assert (descriptors[0].name, descriptors[0].parameters) == (descriptors[1].name, descriptors[1].parameters)
    assert set(shown.descriptor.options) == set(descriptors[1].parameters)
    for config in (shown, default):
        reachable = ReachableViews.of(geometry_of(config.rig))
        interpreter: Any = make_interpreter(config.interpreter, models, descriptors[0])
        planner: Any = make_planner(config.planner, models, reachable)
        assert interpreter.options == FilterOptions()
        assert planner.options == InformationOptions()
    for kind, options in (("interpreter", FilterOptions()), ("planner", InformationOptions())):
        plugin: PluginConfig = getattr(shown, kind)
        assert set(plugin.options) == set(options.__dataclass_fields__), f"{kind}: not all options are shown"
    assert shown.rig.preset == "gimbal"
    plain = {"descriptor": default.descriptor, "interpreter": default.interpreter, "planner": default.planner}
    assert shown.model_copy(update={**plain, "rig": default.rig}) == default


@pytest.mark.needs_pybullet
@pytest.mark.parametrize("name", PRESETS)
def test_every_example_configuration_separates(name: str, shell: Shell, lib: Path, tmp_path: Path) -> None:
    text = (CONFIGS / f"{name}.toml").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("max_looks")]
    if "[task]" not in lines:
        lines.append("[task]")
    lines.insert(lines.index("[task]") + 1, "max_looks = 8")
    (tmp_path / "c.toml").write_text("\n".join(lines))
    ended = shell("separate", "--models", lib, "--truth", NAMES[1], "--config", tmp_path / "c.toml", "--json")
    assert ended.code in (0, 3, 5), ended.err
    assert 1 <= ended.json["looks"] <= 8
    assert ended.json["travel_deg"] > 0


@pytest.mark.needs_pybullet
def test_ctrl_c_ends_in_good_order_with_a_whole_recording(lib: Path, tmp_path: Path) -> None:
    (tmp_path / "c.toml").write_text("[task]\nmax_looks = 400\n")
    (model,) = load_library(lib, NAMES[:1])
    for name in (model.name, "copy"):  # nothing tells them apart, and the seed's method never says so: this takes long
        save(replace(model, name=name), tmp_path / "lib")
    typed = [
        "separate",
        "--models",
        "lib",
        "--truth",
        "product_5",
        "--config",
        "c.toml",
        "--record",
        "run.mcap",
        "--json",
        *SEED_OPTIONS,
    ]
    process = subprocess.Popen(
        [sys.executable, "-m", "viewsep", *typed, "--record", "run.mcap"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    part, models = tmp_path / "run.mcap.part", sum(path.stat().st_size for path in (tmp_path / "lib").iterdir())
    deadline = time.monotonic() + 30
    while (not part.exists() or part.stat().st_size < models + 1_000_000) and process.poll() is None:
        assert time.monotonic() < deadline, "the recording does not grow"
        time.sleep(0.02)  # with a first chunk of messages on disk the task is well under way, and far from its end
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=30)
    assert process.returncode == 130, err
    assert err == ""
    assert json.loads(out)["outcome"] == "failed"
    assert not part.exists()
    recording = read_recording(tmp_path / "run.mcap")
    assert sum(isinstance(r.message, CancelRequested) for r in recording.messages) == 1
    results = [r.message for r in recording.messages if isinstance(r.message, Result)]
    assert [result.outcome for result in results] == [Outcome.FAILED]
    assert verify(recording).outputs > 3
