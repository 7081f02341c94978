"""One separation task on the simulated rig, from models to a scored answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from viewsep.account import pose_spread_deg, telling_view_deg
from viewsep.assembly import make_engine
from viewsep.built_rig import BuiltRig, PictureKind, SimulatedRig
from viewsep.calibration.compensation import compensated
from viewsep.config import Config
from viewsep.errors import BadInput
from viewsep.geometry import matrix_to_quaternion, rotation_angle
from viewsep.interfaces import Listener
from viewsep.messages import Outcome, Result
from viewsep.models.aspect_graph import AspectGraph
from viewsep.perception import RigPerception
from viewsep.perception.setup import finder_of
from viewsep.plugins import make_descriptor
from viewsep.recording import in_background, task_recorder
from viewsep.rigs import check_held, is_real, pace_of, rig_for
from viewsep.session import Session
from viewsep.sim.render_cache import RenderCache
from viewsep.sim.source import absolute_source
from viewsep.sim.view_set import is_view_set

PATIENCE_S = 10.0  # a simulated rig waits for a slow disk, a real one stands still meanwhile


@dataclass(frozen=True, slots=True)
class Task:
    """What to do: the object before a simulated camera (`source`, empty before a real one), its model's name (`truth`,
    empty where that is not known), the seed.

    `record` is where the recording goes, None for none.
    """

    source: str
    truth: str
    seed: int
    record: Path | None = None
    overwrite: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class Answer:
    """The engine's result beside the truth. `pose_error_rad` is nan where the truth is not among the candidates.

    `correct` says whether what was said is so, None where nothing was: `unknown` is right of what no candidate was
    learned from, `indistinguishable` where the truth is one of those that remain. Of a real camera's answers nothing is
    known. `pictures` says what the camera showed, `rig` in words what moved and what saw.
    """

    task: Task
    result: Result
    correct: bool | None
    pose_error_rad: float
    pictures: PictureKind
    rig: str

    def as_dict(self) -> dict[str, Any]:
        """For JSON: degrees, quaternion x, y, z, w."""
        result = self.result
        return {
            "outcome": result.outcome.value,
            "object": result.object or None,
            "indistinct": list(result.indistinct),
            "telling_view_deg": telling_view_deg(result),
            "reason": result.reason,
            "truth": self.task.truth or None,
            "correct": self.correct,
            "ratings": dict(result.ratings),
            "pose_quaternion_xyzw": matrix_to_quaternion(result.rotation).tolist(),
            "pose_spread_deg": pose_spread_deg(result),
            "pose_error_deg": None if np.isnan(self.pose_error_rad) else float(np.degrees(self.pose_error_rad)),
            "looks": result.looks,
            "travel_deg": float(np.degrees(result.travel_rad)),
            "comparisons": result.comparisons,
            "seed": self.task.seed,
            "simulated": self.pictures is not PictureKind.CAMERA,  # the rig, or at least its camera
            "rig": self.rig,
            "pictures": self.pictures.value,
            "recording": str(self.task.record) if self.task.record else None,
        }


def held_object(
    models: Sequence[AspectGraph], truth: str | None, source: str | None, config: Config | None = None
) -> tuple[str, str]:
    """Source and model name of what the simulated rig holds: `truth` names a candidate, or `source` any object.

    A candidate that was learned on the rig has no source to hold: then both are given. What is before a real camera is
    not known, both are empty. Raises BadInput when neither is given, or what does not go together.
    """
    if config is not None and is_real(config):
        check_held(config, truth or source or "")
        return "", ""
    learned_there = {model.name for model in models if is_view_set(Path(model.provenance.source))}
    if truth in learned_there and source is not None and not is_view_set(Path(source)):
        return source, truth or ""
    if (truth is None) == (source is None):
        raise BadInput(
            "the simulated rig must hold something: give --truth NAME (a candidate) or --object SOURCE (a mesh, a "
            "folder of photos, or generated:SEED), not both"
        )
    if source is not None:
        return source, ""
    for model in models:
        if model.name == truth:
            return model.provenance.source, model.name
    raise BadInput(f"--truth {truth!r} is not a candidate: choose one of {', '.join(m.name for m in models)}")


def run_task(
    task: Task,
    config: Config,
    models: Sequence[AspectGraph],
    listeners: Sequence[Listener] = (),
    on_start: Callable[[Session], None] = lambda _session: None,
    cache: RenderCache | None = None,
) -> Answer:
    """Carry out a task. `on_start` gets the session before it runs, so that it can be cancelled. `cache` saves
    rendering what was rendered before.

    Raises BadInput, RigError. A recording is finished whatever happens.
    """
    built = rig_for(config, task.source, task.seed, models=models, cache=cache)
    config = built.config
    engine = make_engine(config, models)
    if isinstance(built, SimulatedRig):
        _check_source(task, models, built.object_digest)
    rig = compensated(built.rig, config)
    perception = RigPerception(rig, make_descriptor(config.descriptor), finder_of(config))
    session = Session(built.rig, engine, perception, pace_of(config), listeners)
    on_start(session)
    if task.record is None:
        with session:
            result = session.run(task.seed)
    else:
        result = _run_recorded(task, task.record, config, models, session)
    correct, error = _scored(result, task, models, built)
    return Answer(task, result, correct, error, built.pictures, built.described)


def _scored(result: Result, task: Task, models: Sequence[AspectGraph], built: BuiltRig) -> tuple[bool | None, float]:
    """Whether what was said is so, and how far the pose is off, radians; None and nan where that is not known."""
    if not isinstance(built, SimulatedRig):
        return None, np.nan
    digest, error = built.object_digest, np.nan
    if any(model.name == task.truth and model.provenance.source_digest == digest for model in models):
        error = float(rotation_angle(result.rotation, built.true_rotation(result.stamp_ns)))
    known = bool(task.truth) or any(model.provenance.source_digest == digest for model in models)
    return _is_so(result, task.truth, known), error


def _is_so(result: Result, truth: str, known: bool) -> bool | None:
    """Whether what was said is so; `known` says whether the object is a candidate. None where nothing was said."""
    match result.outcome:
        case Outcome.IDENTIFIED:
            return result.object == truth
        case Outcome.UNKNOWN:
            return not known
        case Outcome.INDISTINGUISHABLE if truth:
            return truth in result.indistinct
    return None


def _run_recorded(task: Task, record: Path, config: Config, models: Sequence[AspectGraph], session: Session) -> Result:
    """Run the session and record it; a recording that cannot go on ends the task and is the error that counts."""
    recorder = task_recorder(record, config, models, task.seed, task.truth, overwrite=task.overwrite)
    with in_background(recorder, config, lambda error: session.cancel(str(error)), patience_s=PATIENCE_S) as queued:
        session.listeners = (*session.listeners, queued)
        with session:
            result = session.run(task.seed)
    if queued.error is not None:
        raise queued.error
    if queued.lost:
        raise BadInput(
            f"{record}: {queued.lost} messages are missing from the recording, as the disk could not keep up: record "
            "to a faster one, or raise the key 'recording.queue_mb'"
        )
    return result


def _check_source(task: Task, models: Sequence[AspectGraph], digest: str) -> None:
    """The mesh or the photos must still be those the model was learned from, unless that was on the rig."""
    for model in models:
        own = model.name == task.truth and model.provenance.source == absolute_source(task.source)
        if own and model.provenance.source_digest != digest:
            raise BadInput(
                f"{task.source} has changed since model {model.name!r} was learned from it: learn it again, or name "
                "the object with --object"
            )
