"""The inner model of an object: views on the sphere, who neighbours whom, one feature per view (section III.A)."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field

import numpy as np

from viewsep.geometry import angle_between
from viewsep.messages import Array, BoolArray, FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Provenance:
    """Where a model came from: the source as the user gave it (made absolute), its digest, and the software version."""

    source: str
    source_digest: str
    software: str


@dataclass(frozen=True, eq=False, slots=True)
class Trials:
    """Further looks at the object while it was learned: how far looks lie from what the views predict.

    `directions` (T, 3) float64 unit vectors in the object frame; `features` (T, D) float32; `disturbed` (T,) bool, True
    where light, blur, noise and mask were made worse.
    """

    directions: FloatArray
    features: Array
    disturbed: BoolArray

    def joined(self, others: Trials) -> Trials:
        """These and then others."""
        return Trials(
            np.concatenate([self.directions, others.directions]),
            np.concatenate([self.features, others.features]),
            np.concatenate([self.disturbed, others.disturbed]),
        )


@dataclass(frozen=True, eq=False, slots=True)
class AspectGraph:
    """N views of one object.

    `directions` (N, 3) float64 unit vectors in the object frame; `edges` (E, 2) int32 node pairs; `features` (N, D)
    float32; `thumbnails` (N, h, w, 3) uint8 small pictures for people, never used for deciding. `descriptor` and
    `descriptor_parameters` say what made the features. `trials` are there to learn the scale of the likelihood from;
    None in models that were learned without.
    """

    name: str
    directions: FloatArray
    edges: Array
    features: Array
    thumbnails: Array
    descriptor: str
    descriptor_parameters: dict[str, float | int | str]
    provenance: Provenance
    trials: Trials | None = None
    digest: str = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "digest", self._digest())

    def _digest(self) -> str:
        """SHA-256 over all that decides: name, descriptor, directions, edges, features, trials. Not the provenance."""
        h = hashlib.sha256()
        h.update(json.dumps([self.name, self.descriptor, self.descriptor_parameters], sort_keys=True).encode())
        arrays = [(self.directions, "<f8"), (self.edges, "<i4"), (self.features, "<f4")]
        if self.trials is not None:
            arrays += [(self.trials.directions, "<f8"), (self.trials.features, "<f4"), (self.trials.disturbed, "|b1")]
        for array, kind in arrays:
            h.update(str(array.shape).encode())
            h.update(np.ascontiguousarray(array, dtype=kind).tobytes())
        return h.hexdigest()

    @property
    def spacing_rad(self) -> float:
        """Mean angle between neighbouring views in radians."""
        a, b = self.edges.T
        return float(angle_between(self.directions[a], self.directions[b]).mean())

    def neighbours(self) -> Array:
        """(N, K) int32: column 0 is the node itself, then its neighbours, then -1 as padding."""
        count = len(self.directions)
        near: list[list[int]] = [[node] for node in range(count)]
        for a, b in self.edges:
            near[a].append(int(b))
            near[b].append(int(a))
        padded = np.full((count, max(len(row) for row in near)), -1, np.int32)
        for node, row in enumerate(near):
            padded[node, : len(row)] = row
        return padded
