"""Learning an object on the rig: photograph one placement of it, then learn from all placements there are."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from viewsep.capture.folder import CaptureFolder
from viewsep.capture.placements import Placement, merged, registered
from viewsep.capture.plan import Shot, plan_shots
from viewsep.capture.run import Skipped, take_photos
from viewsep.config import Config
from viewsep.errors import BadInput, RigError, try_all
from viewsep.interfaces import Perception
from viewsep.learning import learn_view_set
from viewsep.messages import JointState
from viewsep.models.aspect_graph import AspectGraph
from viewsep.planning.reachable import ReachableViews
from viewsep.session import Rig
from viewsep.sim.view_set import read_view_set

PLACEMENT, MERGED = "placement_", "merged"
FEWEST_PHOTOS = 8  # of a placement


@dataclass(frozen=True, slots=True)
class Lesson:
    """What is learned: the object's `name`, its photos' `folder`, which `placement` is photographed now.

    `spacing_deg` is the widest angle between neighbouring views, `trials` the share of further photos between them.
    """

    name: str
    folder: Path
    placement: int = 1
    spacing_deg: float = 22.5
    trials: float = 0.5

    @property
    def photos(self) -> Path:
        """The folder of this placement."""
        return self.folder / f"{PLACEMENT}{self.placement}"


def shots_of(lesson: Lesson, rig: Rig) -> list[Shot]:
    """What is to be photographed, the same whenever it is gone on with."""
    reachable = ReachableViews.of(rig.geometry)
    start = reachable.nearest(rig.geometry.view_direction(rig.geometry.home()))
    return plan_shots(reachable, start, np.radians(lesson.spacing_deg), lesson.trials)


def photograph(
    lesson: Lesson,
    rig: Rig,
    perception: Perception,
    rig_config: str,
    tick: Callable[[str], None] = lambda problem: None,
    watch: Callable[[JointState], None] = lambda state: None,
) -> tuple[list[Skipped], int]:
    """Photograph this placement, or what is missing of it; what was skipped, and how many photos there are now.

    `rig_config` says with which rig it was begun: going on with another one is refused. The motion is stopped and all
    is closed at the end. Raises RigError, BadInput.
    """
    plan = {
        "name": lesson.name,
        "placement": lesson.placement,
        "spacing_deg": lesson.spacing_deg,
        "trials": lesson.trials,
        "rig": rig_config,
    }
    folder = CaptureFolder(lesson.photos, plan)
    shots, closing = shots_of(lesson, rig), (rig.motion.close, rig.camera.close)
    try:
        rig.motion.connect()
        rig.camera.connect()
        skipped = take_photos(rig, perception, shots, folder, tick, watch)
    except BaseException as error:
        with suppress(RigError):  # what went wrong first is what counts
            try_all(closing)
        if isinstance(error, RigError) and folder.photos:
            kept = f"{len(folder.photos)} of {len(shots)} photos are kept in {lesson.photos}"
            raise RigError(f"{error}; {kept}: put it right, and the same command goes on") from error
        raise
    try_all(closing)
    if len(folder.photos) < FEWEST_PHOTOS:
        raise BadInput(
            f"{lesson.photos}: {len(folder.photos)} photos are too few (at least {FEWEST_PHOTOS}); give a smaller "
            "--spacing"
        )
    folder.finish()
    return skipped, len(folder.photos)


def learn_from_placements(lesson: Lesson, config: Config) -> tuple[AspectGraph, int]:
    """The model from the photos of all placements that are complete, and how many these are. Raises BadInput.

    Every further placement is registered to those before it, in the order of their numbers.
    """
    folders = [path.parent for path in lesson.folder.glob(f"{PLACEMENT}*/views.csv")]
    first, *further = [read_view_set(path) for path in sorted(folders, key=lambda path: int(path.name.split("_")[-1]))]
    placements = [Placement(first, np.eye(3))]
    model = learn_view_set(first.folder, lesson.name, config)
    for view_set in further:
        placements.append(registered(model, view_set, config))
        merged(placements, lesson.folder / MERGED)
        model = learn_view_set(lesson.folder / MERGED, lesson.name, config)
    return model, len(placements)
