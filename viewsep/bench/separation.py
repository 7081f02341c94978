"""One separation task under one method: the whole loop on the rig, scored against the truth (section V.B)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from viewsep.assembly import make_engine, reachable_views
from viewsep.bench.journal import Row
from viewsep.bench.methods import Method
from viewsep.bench.observer import Observer
from viewsep.bench.optimum import clairvoyant_travel
from viewsep.bench.setup import Setup
from viewsep.bench.stopwatch import TimedEngine
from viewsep.bench.summary import verdict
from viewsep.bench.symmetry import symmetries
from viewsep.bench.tasks import SeparationTask
from viewsep.built_rig import SimulatedRig
from viewsep.calibration.compensation import compensated
from viewsep.engine.engine import Engine
from viewsep.errors import RigError
from viewsep.geometry import rotation_angle
from viewsep.messages import FloatArray, Result
from viewsep.models.aspect_graph import AspectGraph
from viewsep.perception import RigPerception
from viewsep.plugins import make_descriptor
from viewsep.rigs import pace_of
from viewsep.session import Session

EngineType = TypeVar("EngineType", bound=Engine)


@dataclass(frozen=True, eq=False, slots=True)
class TaskRun(Generic[EngineType]):
    """A task that was carried out; `result` is None where the rig failed, and `failure` says how."""

    held: SimulatedRig
    models: list[AspectGraph]
    engine: EngineType
    observer: Observer
    result: Result | None
    failure: str = ""


def carry_out(
    task: SeparationTask, method: Method, setup: Setup, engine_from: Callable[[Engine], EngineType]
) -> TaskRun[EngineType]:
    """The whole loop on the rig, with an engine made from the method's."""
    held = setup.hold(task.source, method.config, task.seed)
    models = [setup.model(source, held.config) for source in task.candidates]
    engine, observer = engine_from(make_engine(held.config, models)), Observer()
    perception = RigPerception(compensated(held.rig, held.config), make_descriptor(held.config.descriptor))
    try:
        with Session(held.rig, engine, perception, pace_of(held.config), [observer]) as session:
            return TaskRun(held, models, engine, observer, session.run(task.seed))
    except RigError as error:
        return TaskRun(held, models, engine, observer, None, str(error))


def separation_row(task: SeparationTask, method: Method, setup: Setup) -> Row:
    """Carry out the task and score it. A rig that fails is a failed task, not the end of the experiment."""
    run = carry_out(task, method, setup, TimedEngine)
    result, engine, observer = run.result, run.engine, run.observer
    row: Row = {
        "index": task.index,
        "seed": task.seed,
        "method": method.name,
        "truth": task.truth,
        "known": task.known,
        "identical": task.identical,
        "candidates": [model.name for model in run.models],
        "unknown_probability": None,
    }
    if result is None:
        return row | {"outcome": "failed", "verdict": "failed", "object": "", "reason": run.failure}
    rotation = run.held.true_rotation(result.stamp_ns)
    return (
        row
        | _answer(task, result)
        | _pose_errors(task, result, rotation, setup)
        | _travel(task, run.held, setup, rotation, observer.start, result)
        | {
            "unknown_probability": observer.estimates[-1].unknown if observer.estimates else None,
            "comparisons_per_look": result.comparisons / max(1, result.looks) / len(run.models),
            "comparisons_converged": observer.comparisons_converged(),
            "step_ms": 1e3 * float(np.median(engine.wall_s)) if engine.wall_s else None,
            "step_cpu_ms": 1e3 * float(np.median(engine.cpu_s)) if engine.cpu_s else None,
            "course": observer.course(task.truth),
        }
    )


def _answer(task: SeparationTask, result: Result) -> dict[str, Any]:
    """What was said, and whether it is so."""
    return {
        "outcome": result.outcome.value,
        "object": result.object,
        "indistinct": list(result.indistinct),
        "reason": result.reason,
        "verdict": verdict(result.outcome.value, result.object, task.truth, task.known, task.identical),
        "looks": result.looks,
    }


def _pose_errors(task: SeparationTask, result: Result, rotation: FloatArray, setup: Setup) -> dict[str, float | None]:
    """How far the pose is off the true one, and off the closest that looks the same; None where there is none."""
    if not task.known or result.looks == 0:
        return {"pose_error_deg": None, "pose_error_symmetric_deg": None}
    return {
        "pose_error_deg": float(np.degrees(rotation_angle(result.rotation, rotation))),
        "pose_error_symmetric_deg": float(np.degrees(symmetries(task.source, setup).error(result.rotation, rotation))),
    }


def _travel(
    task: SeparationTask,
    held: SimulatedRig,
    setup: Setup,
    rotation: FloatArray,
    start: FloatArray | None,
    result: Result,
) -> dict[str, Any]:
    """How far it went and how far the clairvoyant would have gone; a look's distance at the least for both."""
    travel = float(np.degrees(result.travel_rad))
    shortest = None
    if start is not None:
        truth = setup.model(task.source, held.config)
        rivals = [setup.model(source, held.config) for source in task.candidates if source != task.source]
        reachable = reachable_views(held.config.rig)
        way = clairvoyant_travel(truth, rivals, rotation, reachable, start)
        shortest = float(np.degrees(way)) if np.isfinite(way) else None
    look = held.config.task.look_every_deg
    ratio = None if shortest is None else max(travel, look) / max(shortest, look)
    return {"travel_deg": travel, "optimum_deg": shortest, "travel_over_optimum": ratio}
