"""An experiment from its tasks to its report: learn the objects, let the workers do the tasks, keep what is done."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from viewsep import __version__
from viewsep.bench.baselines import baseline_row
from viewsep.bench.calibration import calibration_row, check_probabilities
from viewsep.bench.journal import Journal, Row
from viewsep.bench.looks import looks_row, looks_summary
from viewsep.bench.methods import Method
from viewsep.bench.pose import PoseRun, pose_rows
from viewsep.bench.report import Report
from viewsep.bench.runner import Call, Workers, run_calls
from viewsep.bench.separation import separation_row
from viewsep.bench.setup import Setup
from viewsep.bench.symmetry import symmetries
from viewsep.bench.tasks import SeparationTask
from viewsep.config import Config
from viewsep.files import write_whole
from viewsep.planning.exploration import Exploration
from viewsep.sim.source import object_name

Progress = Callable[[str, int], Callable[[Row], None]]
"""Called with what begins and how many rows it will have; what it returns hears of every row."""


@dataclass(frozen=True)
class Running:
    """How an experiment is carried out, which changes nothing of its result.

    With a `result` file, finished rows are kept in a journal beside it until the report is written; `resume` goes on
    with those of a run that was stopped.
    """

    workers: Workers
    progress: Progress
    result: Path | None = None
    resume: bool = False


def run_separation(
    tasks: Sequence[SeparationTask],
    methods: Sequence[Method],
    baselines: Sequence[str],
    setup: Setup,
    running: Running,
    about: dict[str, Any],
) -> Report:
    """Every task under every method, then under the baselines with as many looks as the first method took.

    Raises BadInput for objects that cannot be used, and Interrupted.
    """
    experiment = _experiment(tasks, methods, setup, running) | {"baselines": list(baselines)}
    journal = _journal(experiment, running)
    by_method = _by_method(separation_row, tasks, methods, setup, journal, running)
    if baselines:
        looks = [max(1, row.get("looks", 1)) for row in by_method[: len(tasks)]]
        calls = [
            Call(f"{name} {task.index}", baseline_row, (task, name, count, methods[0].config, setup))
            for name in baselines
            for task, count in zip(tasks, looks, strict=True)
        ]
        by_method += run_calls(calls, running.workers, journal, running.progress("baselines", len(calls)))
    return _reported(Report("separation", about, by_method), journal, running)


def run_calibration(
    tasks: Sequence[SeparationTask],
    methods: Sequence[Method],
    setup: Setup,
    running: Running,
    about: dict[str, Any],
) -> Report:
    """Every task under every method, to its last look.

    Raises BadInput for interpreters without probabilities and for objects that cannot be used, and Interrupted.
    """
    for method in methods:
        check_probabilities(tasks[0], method, setup)
    experiment = _experiment(tasks, methods, setup, running) | {"kind": "calibration"}
    journal = _journal(experiment, running)
    rows = _by_method(calibration_row, tasks, methods, setup, journal, running)
    return _reported(Report("calibration", about, rows), journal, running)


def run_looks(
    tasks: Sequence[SeparationTask],
    methods: Sequence[Method],
    baselines: Sequence[str],
    looks: int,
    setup: Setup,
    running: Running,
    about: dict[str, Any],
) -> dict[str, Any]:
    """Who is right after how many looks, all on the same pictures: figures by method and number of looks, and the rows.

    Raises BadInput for objects that cannot be used, and Interrupted.
    """
    experiment = _experiment(tasks, methods, setup, running) | {"baselines": list(baselines), "looks": looks}
    journal = _journal(experiment, running)
    calls = [Call(str(task.index), looks_row, (task, methods, baselines, looks, setup)) for task in tasks]
    rows = run_calls(calls, running.workers, journal, running.progress("looking", len(calls)))
    found = {
        "kind": "looks",
        "software": f"viewsep {__version__}",
        "about": about,
        "after": looks_summary(rows),
        "tasks": rows,
    }
    if running.result is not None:
        write_whole(running.result, json.dumps(found, indent=1, allow_nan=False).encode(), "result")
    if journal is not None:
        journal.remove()
    return found


def run_pose(
    runs: Sequence[PoseRun],
    methods: Sequence[Method],
    exploration: Exploration,
    setup: Setup,
    running: Running,
    about: dict[str, Any],
) -> Report:
    """Every run under every method. Raises BadInput for objects that cannot be used, and Interrupted."""
    experiment = {
        "runs": [asdict(run) for run in runs],
        "methods": _named(methods),
        "exploration": exploration,
        "setup": [setup.views],
        "models": _learn(sorted({run.source for run in runs}), methods[0].config, setup, running),
    }
    journal = _journal(experiment, running)
    calls = [Call(str(run.index), pose_rows, (run, methods, exploration, setup)) for run in runs]
    done = run_calls(calls, running.workers, journal, running.progress("pose runs", len(calls)))
    rows = [row["rows"][k] for k in range(len(methods)) for row in done]
    return _reported(Report("pose", about, rows), journal, running)


def _experiment(
    tasks: Sequence[SeparationTask], methods: Sequence[Method], setup: Setup, running: Running
) -> dict[str, Any]:
    """What decides the rows of tasks under methods; the objects are learned for it."""
    sources = sorted({source for task in tasks for source in (task.source, *task.candidates)})
    return {
        "tasks": [asdict(task) for task in tasks],
        "methods": _named(methods),
        "setup": [setup.views, setup.every],
        "models": _learn(sources, methods[0].config, setup, running),
    }


def _by_method(
    function: Callable[[SeparationTask, Method, Setup], Row],
    tasks: Sequence[SeparationTask],
    methods: Sequence[Method],
    setup: Setup,
    journal: Journal | None,
    running: Running,
) -> list[Row]:
    """A row for every task under every method, the first method's first."""
    calls = [
        Call(f"{method.name} {task.index}", function, (task, method, setup)) for task in tasks for method in methods
    ]
    rows = run_calls(calls, running.workers, journal, running.progress("separating", len(calls)))
    return [row for k in range(len(methods)) for row in rows[k :: len(methods)]]


def list_symmetries(sources: Sequence[str], setup: Setup, running: Running) -> list[Row]:
    """A row for each object: the turns that change nothing, how many poses look alike. Raises BadInput, Interrupted."""
    calls = [Call(source, _symmetries_row, (source, setup)) for source in sources]
    return run_calls(calls, running.workers, None, running.progress("objects", len(calls)))


def _symmetries_row(source: str, setup: Setup) -> Row:
    found = symmetries(source, setup)
    turns = [{"axis": [round(float(x), 4) + 0.0 for x in turn.axis], "degrees": turn.degrees} for turn in found.turns]
    return {"name": object_name(source), "turns": turns, "alike": "any" if found.axes else str(len(found.rotations))}


def _learn(sources: Sequence[str], config: Config, setup: Setup, running: Running) -> dict[str, str]:
    """Name -> digest of every object's model. Afterwards the workers find the pictures of the views in the cache."""
    calls = [Call(source, _learned_row, (source, config, setup)) for source in sources]
    rows = run_calls(calls, running.workers, None, running.progress("learning", len(calls)))
    return {row["name"]: row["digest"] for row in rows}


def _learned_row(source: str, config: Config, setup: Setup) -> Row:
    model = setup.model(source, config)
    return {"name": model.name, "digest": model.digest}


def _named(methods: Sequence[Method]) -> dict[str, str]:
    return {method.name: method.config.model_dump_json() for method in methods}


def _journal(experiment: dict[str, Any], running: Running) -> Journal | None:
    if running.result is None:
        return None
    decisive = json.dumps([__version__, experiment], sort_keys=True).encode()
    return Journal(running.result, hashlib.sha256(decisive).hexdigest(), running.resume)


def _reported(report: Report, journal: Journal | None, running: Running) -> Report:
    """Write the report where it is wanted; only then the journal may go."""
    if running.result is not None:
        report.write(running.result)
    if journal is not None:
        journal.remove()
    return report
