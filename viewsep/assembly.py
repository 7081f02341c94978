"""From configuration and models to an engine: the same way for live sessions, replay and benchmarks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from viewsep.config import Config, RigConfig, geometry_of
from viewsep.engine.engine import Engine
from viewsep.engine.state import TaskLimits
from viewsep.errors import BadConfig, BadInput, BadModel
from viewsep.geometry import spherical_direction
from viewsep.interfaces import Descriptor
from viewsep.models.aspect_graph import AspectGraph
from viewsep.planning.reachable import ReachableViews
from viewsep.plugins import make_descriptor, make_interpreter, make_planner


def make_engine(config: Config, models: Sequence[AspectGraph]) -> Engine:
    """The engine for these candidates on this rig. Raises BadInput, BadConfig, BadModel."""
    if len(models) < 2:
        raise BadInput(
            f"{len(models)} candidate: there is nothing to separate; learn another look-alike or name more candidates"
        )
    descriptor = make_descriptor(config.descriptor)
    check_descriptor(models, descriptor)
    interpreter = make_interpreter(config.interpreter, models, descriptor)
    reachable = reachable_views(config.rig)
    planner = make_planner(config.planner, models, reachable)
    if getattr(planner, "needs_samples", False) and not getattr(interpreter, "gives_samples", False):
        raise BadConfig(
            f"planner {config.planner.name!r} plans with probabilities, and {config.interpreter.name!r} has "
            "none: choose planner 'separating', or interpreter 'filter'"
        )
    if config.task.look_around > 0.0 and not getattr(interpreter, "gives_samples", False):
        raise BadConfig(
            f"task.look_around = {config.task.look_around:g}: interpreter {config.interpreter.name!r} does not keep "
            "the views it has seen: choose interpreter 'filter', or 0"
        )
    return Engine(
        interpreter,
        planner,
        TaskLimits(
            look_every_rad=float(np.radians(config.task.look_every_deg)),
            judge_within_rad=float(np.radians(config.task.judge_within_deg)),
            confirming_looks=config.task.confirming_looks,
            max_looks=config.task.max_looks,
            max_failed_moves=config.task.max_failed_moves,
            max_missing_frames=config.task.max_missing_frames,
            pose_tolerance_rad=float(np.radians(config.task.pose_tolerance_deg or np.inf)),
            look_around=config.task.look_around,
        ),
        reachable,
    )


def reachable_views(rig: RigConfig) -> ReachableViews:
    """What the planner may ask for: all views of the joints, or exactly those of the photos. Raises BadConfig."""
    if rig.backend != "photos":
        return ReachableViews.of(geometry_of(rig))
    if not rig.views_deg:
        raise BadConfig("rig.backend = 'photos', but no view set is held: name a folder of photos, or use 'sim'")
    return ReachableViews.only(np.array([spherical_direction(*view) for view in np.radians(rig.views_deg)]))


def check_descriptor(models: Sequence[AspectGraph], descriptor: Descriptor) -> None:
    """Percepts and models must come from the same descriptor. Raises BadModel."""
    for model in models:
        same = (model.descriptor, model.descriptor_parameters) == (descriptor.name, descriptor.parameters)
        if not same or model.features.shape[1] != descriptor.size:
            raise BadModel(
                f"model {model.name!r} was learned with descriptor {model.descriptor} {model.descriptor_parameters}, "
                f"but the configuration says {descriptor.name} {descriptor.parameters}: learn it again or change the "
                "key 'descriptor'"
            )
