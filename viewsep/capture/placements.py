"""Photos of an object in several placements, registered to each other by the pose filter, as one view set."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from viewsep.config import Config
from viewsep.errors import BadInput
from viewsep.geometry import spacing_of
from viewsep.interpretation.pose_filter import FilterInterpreter
from viewsep.messages import BoolArray, FloatArray, Percept
from viewsep.models.aspect_graph import AspectGraph
from viewsep.plugins import make_descriptor
from viewsep.sim.view_set import LIST_NAME, Use, ViewSet, view_list

SURE = 0.9  # probability that it is the same object
WITHIN_RAD = np.radians(8.0)  # spread of the pose
SAME_VIEW_RAD = np.radians(0.1)  # closer photos are of the same view
COVERED = 0.6  # of the spacing of views: a view that has one so near in an earlier placement becomes a trial


@dataclass(frozen=True, eq=False, slots=True)
class Placement:
    """Photos whose directions are turned into the object's frame by `rotation` (3, 3), object -> control."""

    view_set: ViewSet
    rotation: FloatArray

    @property
    def directions(self) -> FloatArray:
        """(N, 3) in the object frame."""
        return np.asarray(self.view_set.directions @ self.rotation)


def registered(model: AspectGraph, view_set: ViewSet, config: Config) -> Placement:
    """How the object of `model` stood when photos of it were taken again. Raises BadInput where that is not clear."""
    descriptor = make_descriptor(config.descriptor)
    interpreter = FilterInterpreter([model], descriptor)
    state, belief = interpreter.start(), None
    for index, direction in enumerate(view_set.directions):
        feature = descriptor.describe(*view_set.picture(index, config.camera.size_px))
        percept = Percept(index, index, descriptor.name, feature, direction)
        state, belief = interpreter.update(state, percept)
    assert belief is not None
    (candidate,) = belief.estimate.candidates
    if (candidate.probability or 0.0) < SURE:
        raise BadInput(
            f"{view_set.folder}: does not look like {model.name} in its earlier placements (probability "
            f"{candidate.probability:.2f}); is it the same object, and do the placements share some views?"
        )
    if candidate.variance > WITHIN_RAD**2:
        raise BadInput(
            f"{view_set.folder}: how {model.name} stands is known to {np.degrees(np.sqrt(candidate.variance)):.0f} "
            "degrees only; turn it less between placements, so that more views are shared"
        )
    return Placement(view_set, candidate.rotation)


def merged(placements: Sequence[Placement], out: Path) -> None:
    """Write the photos of all placements as one view set.

    What an earlier placement shows already is seen again: those photos become trials. What was in `out` is replaced.
    Raises BadInput.
    """
    partial = out.with_name(f"{out.name}.part")
    try:
        shutil.rmtree(partial, ignore_errors=True)
        for part in ("images", "masks"):
            (partial / part).mkdir(parents=True)
        (partial / LIST_NAME).write_bytes(view_list(_rows(placements, partial)))
        shutil.rmtree(out, ignore_errors=True)
        partial.replace(out)
    except OSError as error:
        raise BadInput(f"cannot write the merged photos {out}: {error.strerror}; choose another place") from error


def _rows(placements: Sequence[Placement], folder: Path) -> list[tuple[str, FloatArray, str, Use]]:
    """Copy the files that are kept; their lines of the list."""
    rows: list[tuple[str, FloatArray, str, Use]] = []
    photos = views = np.empty((0, 3))
    for number, placement in enumerate(placements, start=1):
        view_set, directions = placement.view_set, placement.directions
        spacing = spacing_of(directions[~view_set.trial])
        new = _away(directions, photos, SAME_VIEW_RAD)
        view = new & ~view_set.trial & _away(directions, views, COVERED * spacing)
        for index in np.flatnonzero(new):
            image, mask = view_set.images[index], view_set.masks[index]
            copies = [
                f"{part}/{number}_{Path(name).name}" if name else ""
                for part, name in (("images", image), ("masks", mask))
            ]
            for name, copy in zip((image, mask), copies, strict=True):
                if name:
                    shutil.copyfile(view_set.folder / name, folder / copy)
            rows.append((copies[0], directions[index], copies[1], Use.VIEW if view[index] else Use.TRIAL))
        photos, views = np.concatenate([photos, directions[new]]), np.concatenate([views, directions[view]])
    return rows


def _away(directions: FloatArray, others: FloatArray, angle_rad: float) -> BoolArray:
    """(N,) which of (N, 3) directions lie at least `angle_rad` from all others (M, 3)."""
    if len(others) == 0:
        return np.ones(len(directions), bool)
    return np.asarray((directions @ others.T).max(axis=1) < np.cos(angle_rad))
