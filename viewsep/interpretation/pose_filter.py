"""Exact Bayes over (candidate or none of them) x rotation, on a grid (design section 5).

In an estimate `rating` is one over the candidate's probability, `w0` how well the look fits it at best (0 to 1), `w1`
the spread of its pose (radians); it has no `w2`, which is 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from viewsep.geometry import angle_between, nearest_rotation
from viewsep.interfaces import Conclusion, Descriptor, Interpretation
from viewsep.interpretation.likelihood import LAWS, Law, Library
from viewsep.interpretation.rotation_grid import rotation_grid
from viewsep.interpretation.view_cells import cell_of
from viewsep.messages import (
    Array,
    CandidateEstimate,
    Estimate,
    FloatArray,
    HypothesisViews,
    Outcome,
    Percept,
    Phase,
)
from viewsep.models.aspect_graph import AspectGraph

SHOWN = 50  # hypotheses per candidate that are shown to people


@dataclass(frozen=True, slots=True)
class FilterOptions:
    """Settings of the pose filter.

    `rotations` is the size of the grid; `independent_after_deg` how far the view must turn until a percept counts as
    evidence of its own; `confidence` the probability at which a candidate is named; `unknown_prior` that of an object
    that is no candidate; `floor` how far below the best a rotation's log-probability may fall, so that a slip can be
    recovered from; a pose is known when its spread is below `pose_within_deg`.
    """

    rotations: Annotated[int, Field(ge=1000, le=200_000)] = 12_000
    independent_after_deg: Annotated[float, Field(gt=0, le=90)] = 10.0
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.99
    unknown_prior: Annotated[float, Field(ge=0, lt=1)] = 0.05
    floor: Annotated[float, Field(gt=1, le=200)] = 25.0
    pose_within_deg: Annotated[float, Field(gt=0, le=90)] = 12.0


@dataclass(frozen=True, eq=False, slots=True)
class FilterState:
    """`log_p` (K, G) float32 and `log_none` are logarithms of probabilities that sum to 1; `view` (3,) was the last."""

    log_p: Array
    log_none: float
    view: FloatArray | None
    looks: int


class FilterInterpreter:
    """The posterior over who is seen and how it is held."""

    options_type = FilterOptions
    state_type = FilterState

    def __init__(
        self, models: Sequence[AspectGraph], descriptor: Descriptor, options: FilterOptions | None = None
    ) -> None:
        self.options = options or FilterOptions()
        self.library = Library(models, LAWS.get(descriptor.name, Law()))
        self.descriptor = descriptor
        self.rotations = rotation_grid(self.options.rotations)
        columns = self.rotations.transpose(1, 2, 0).reshape(3, -1)
        self._columns = np.ascontiguousarray(columns, np.float32)  # c @ this is every u = R^T c
        self._flat = self.rotations.reshape(len(self.rotations), 9).astype(np.float32)

    def start(self) -> FilterState:
        """Every candidate and rotation as likely as any other."""
        count, grid = len(self.library.names), len(self.rotations)
        each = np.log((1.0 - self.options.unknown_prior) / (count * grid))
        none = float(np.log(self.options.unknown_prior)) if self.options.unknown_prior else -np.inf
        return FilterState(np.full((count, grid), each, np.float32), none, None, 0)

    def update(self, state: FilterState, percept: Percept) -> tuple[FilterState, Interpretation]:
        """Multiply with the likelihood of the percept, as far as it is evidence of its own."""
        turned = np.pi if state.view is None else float(angle_between(state.view, percept.view_direction))
        share = np.float32(min(1.0, turned / np.radians(self.options.independent_after_deg)))
        likelihood = self.library.log_likelihood(percept.feature)
        log_p = state.log_p + share * likelihood[:, self._cells(percept.view_direction)]
        log_none = state.log_none + float(share) * self.library.law.of_nothing
        top = max(float(log_p.max()), log_none)
        log_p = np.maximum(log_p - np.float32(top), np.float32(-self.options.floor))
        total = float(np.log(np.exp(log_p).sum(dtype=np.float64) + np.exp(log_none - top)))
        log_none = max(log_none - top, -self.options.floor) - total
        after = FilterState(log_p - np.float32(total), log_none, percept.view_direction, state.looks + 1)
        return after, self._interpret(after, percept, likelihood)

    def hypotheses(self, state: FilterState, stamp_ns: int) -> HypothesisViews:
        """The most likely rotations of every candidate, where they believe the last view to be."""
        count = len(self.library.names)
        best = np.argpartition(-state.log_p, SHOWN, axis=1)[:, :SHOWN]
        weight = np.exp(np.take_along_axis(state.log_p, best, axis=1)).astype(np.float64).ravel()
        view = np.zeros(3) if state.view is None else state.view
        seen = np.repeat(view[None], count * SHOWN, axis=0)
        owner = np.repeat(np.arange(count), SHOWN)
        return HypothesisViews(stamp_ns, self.library.names, owner, seen, weight / max(weight.sum(), 1e-300))

    def _cells(self, view: FloatArray) -> Array:
        """(G,) the cell each rotation sees the object's sphere in."""
        x, y, z = (view.astype(np.float32) @ self._columns).reshape(3, -1)
        return cell_of(x, y, z)

    def _interpret(self, state: FilterState, percept: Percept, likelihood: Array) -> Interpretation:
        probability = np.exp(state.log_p).sum(axis=1, dtype=np.float64)
        poses = [self._pose(state.log_p[k]) for k in range(len(probability))]
        rotations = np.stack([rotation for rotation, _ in poses])
        limit = np.radians(self.options.pose_within_deg) ** 2
        order = np.argsort(-probability, kind="stable")
        leader = int(order[0]) if probability[order[0]] >= self.options.confidence else -1
        plausible = probability > 0.01 * probability.max()
        plausible[order[:2]] = True
        estimate = Estimate(
            stamp_ns=percept.stamp_ns,
            iteration=state.looks,
            phase=Phase.EXPLORING,
            candidates=tuple(
                CandidateEstimate(
                    name=name,
                    rating=float(1.0 / max(probability[k], 1e-12)),
                    w0=float(np.exp(likelihood[k].max())),
                    w1=float(np.sqrt(poses[k][1])),
                    w2=0.0,
                    rotation=rotations[k],
                    variance=poses[k][1],
                    converged=bool(poses[k][1] < limit),
                    hypotheses=len(self.rotations),
                    probability=float(probability[k]),
                )
                for k, name in enumerate(self.library.names)
            ),
            comparisons=self.library.nodes,
            travel_rad=0.0,
            target=None,
            unknown=float(np.exp(state.log_none)),
        )
        known = None
        if leader >= 0:
            reason = f"its probability is {probability[leader]:.4f} after {state.looks} looks"
            known = Conclusion(Outcome.IDENTIFIED, reason)
        converged = bool(poses[order[0]][1] < limit)
        return Interpretation(estimate, rotations, converged, plausible, leader, fresh=False, conclusion=known)

    def _pose(self, log_p: Array) -> tuple[FloatArray, float]:
        """The mean rotation around the best one (3, 3), and the mean squared angle to it over all."""
        best = int(np.argmax(log_p))
        weight = np.exp(log_p - log_p[best])
        cosine = self._flat @ self._flat[best]  # trace(A^T B) = 1 + 2 cos
        near = np.flatnonzero((cosine > 1.0 + 2.0 * np.cos(np.radians(25.0))) & (weight > 1e-4))
        mean = nearest_rotation(np.tensordot(weight[near].astype(np.float64), self.rotations[near], 1))
        trace = self._flat @ mean.ravel().astype(np.float32)
        angle = np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0))
        spread = float((weight * angle * angle).sum(dtype=np.float64) / weight.sum(dtype=np.float64))
        return mean, spread
