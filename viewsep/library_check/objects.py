"""Each model alone: how much of the sphere it knows, whether it must be learned again, which poses look alike."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from viewsep.geometry import rotation_angle
from viewsep.interfaces import Descriptor
from viewsep.interpretation.unlearned import loans_to
from viewsep.interpretation.view_cells import CELLS, cell_areas
from viewsep.library_check.alignment import Alignment, Candidates, alignments
from viewsep.library_check.pairs import TELLING_BITS
from viewsep.messages import FloatArray
from viewsep.models.aspect_graph import AspectGraph

TURNS_ALIKE = 0.5  # bits of a look on average: poses of one object with less are hard to tell apart


@dataclass(frozen=True, slots=True)
class TurnedPose:
    """Another pose of the same object: turned by an angle about an axis (3,), and what a look tells of which it is."""

    axis: tuple[float, float, float]
    angle_rad: float
    bits: float
    telling: float

    @staticmethod
    def of(alignment: Alignment) -> TurnedPose:
        """By the rotation of an object against itself."""
        rotation = alignment.rotation
        angle = float(rotation_angle(rotation, np.eye(3)))
        known = ~np.isnan(alignment.bits)
        tells = np.nan_to_num(alignment.bits) >= TELLING_BITS
        share = float(cell_areas()[tells].sum() / cell_areas()[known].sum()) if known.any() else 0.0
        x, y, z = _axis(rotation).tolist()
        return TurnedPose((x, y, z), angle, alignment.mean, share)

    @property
    def alike(self) -> bool:
        """Whether the poses are hard to tell apart."""
        return self.bits < TURNS_ALIKE


@dataclass(frozen=True, slots=True)
class Alone:
    """One model: `covered` is the share of the sphere that its views cover; `again` says why it must be learned again.

    `turned` is its other pose in which it looks most as before, None where it looks different however it is turned.
    `lent` are the look-alikes, and shares of the sphere, that it is expected to look like where it was not learned.
    """

    name: str
    views: int
    trials: int
    covered: float
    again: str
    turned: TurnedPose | None
    lent: tuple[tuple[str, float], ...] = ()


def why_again(model: AspectGraph, descriptor: Descriptor) -> str:
    """Why a model has to be learned again to be used with this descriptor, empty where it need not be."""
    if (model.descriptor, model.descriptor_parameters) != (descriptor.name, descriptor.parameters):
        return f"its descriptor is {model.descriptor}, not {descriptor.name}"
    if model.features.shape[1] != descriptor.size:
        return f"its features have {model.features.shape[1]} numbers, not the descriptor's {descriptor.size}"
    return ""


def outdated(model: AspectGraph, descriptor: Descriptor) -> Alone:
    """A model that cannot be compared with the others."""
    trials = 0 if model.trials is None else len(model.trials.directions)
    return Alone(model.name, len(model.directions), trials, float("nan"), why_again(model, descriptor), None)


def alone(candidates: Candidates, which: int) -> Alone:
    """One of the candidates, compared with itself."""
    model = candidates.models[which]
    found = alignments(candidates, which, which)
    known = candidates.predictions.known(which, np.arange(CELLS))
    return Alone(
        name=model.name,
        views=len(model.directions),
        trials=0 if model.trials is None else len(model.trials.directions),
        covered=float(known @ cell_areas()),
        again="" if model.trials is not None else "it has no trials to learn the likelihood from",
        turned=TurnedPose.of(found[0]) if found else None,
        lent=tuple(
            (candidates.names[loan.lender], float(cell_areas()[loan.cells].sum()))
            for loan in loans_to(candidates.predictions, which, model.spacing_rad)
        ),
    )


def _axis(rotation: FloatArray) -> FloatArray:
    """(3,) unit axis of a rotation, its largest component positive."""
    values, vectors = np.linalg.eigh(0.5 * (rotation + rotation.T))
    axis = vectors[:, int(np.argmax(values))]
    upright: FloatArray = axis if axis[int(np.argmax(np.abs(axis)))] > 0.0 else -axis
    return upright
