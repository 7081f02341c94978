"""The interpretation module: percepts in, path hypotheses, poses and ratings out (section IV)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from viewsep.geometry import mean_rotation
from viewsep.interfaces import Descriptor, Interpretation
from viewsep.interpretation.candidates import Candidates
from viewsep.interpretation.convergence import WINDOW, running_variance
from viewsep.interpretation.hypotheses import (
    Hypotheses,
    children_of,
    distinct_paths,
    grow,
    most_similar_child,
    without_loop,
)
from viewsep.interpretation.rating import accumulated_similarity, best_per_candidate, mean_position, path_course
from viewsep.interpretation.transformation import align_start_and_end, align_whole_path, arc_end
from viewsep.messages import (
    Array,
    BoolArray,
    CandidateEstimate,
    Estimate,
    FloatArray,
    HypothesisViews,
    Percept,
    Phase,
)
from viewsep.models.aspect_graph import AspectGraph

Variant = Literal["initial", "particles", "loop_free", "accumulated"]
Alignment = Literal["fig4", "wahba"]
Measure = Literal["w0", "w1", "w2"]

CONVERGED_DEG2: dict[Alignment, float] = {"fig4": 3.0, "wahba": 1.0}
UNSETTLED = 10.0  # how much higher than it converged a running variance must rise to count as not converged again

SELECTED_BY: dict[Variant, tuple[Measure, ...]] = {
    "initial": ("w0",),
    "particles": ("w0", "w1"),
    "loop_free": ("w0", "w1"),
    "accumulated": ("w0", "w1", "w2"),
}


@dataclass(frozen=True, slots=True)
class PathOptions:
    """Settings of the path interpreter.

    `variant` is the step of section IV.A-D to stop at; `alignment` Fig. 4's transformation or the fit over the whole
    path; `rated_by` the measures that make the final rating (empty: those of the variant); `hypotheses` is N_hypo per
    candidate; a pose has converged when its running variance falls below `converged_below_deg2` (0: 3 for Fig. 4's
    transformation and 1 for the fit, which moves less from look to look), until it rises above ten times that;
    `plausible_within` says how much worse than the
    best a rating may be for the candidate to count as a rival; when no hypothesis at all follows the controlled path
    within `lost_above_deg` (w1), all are lost and new paths begin; so they do after `longest_path` hits, when the
    rating has not decided at several separating views and a fresh start is the better chance. Poses that have not
    converged after `settle_within` hits are planned with as they are: an object that looks the same all around never
    converges.
    """

    variant: Variant = "accumulated"
    alignment: Alignment = "fig4"
    rated_by: tuple[Measure, ...] = ()
    hypotheses: Annotated[int, Field(ge=1, le=10_000)] = 50
    converged_below_deg2: Annotated[float, Field(ge=0, allow_inf_nan=False)] = 0.0
    plausible_within: Annotated[float, Field(ge=1, allow_inf_nan=False)] = 5.0
    lost_above_deg: Annotated[float, Field(gt=0, le=180)] = 18.0
    longest_path: Annotated[int, Field(ge=10, le=10_000)] = 100
    settle_within: Annotated[int, Field(ge=1, le=10_000)] = 40

    @property
    def variance_limit_deg2(self) -> float:
        """The bound on the running variance that holds for this alignment."""
        return self.converged_below_deg2 or CONVERGED_DEG2[self.alignment]


@dataclass(frozen=True, eq=False, slots=True)
class PathState:
    """Everything the interpreter remembers between percepts; the percept itself is forgotten (section II.3).

    `controlled` (H, 3) is the controlled path p_c; `best_similarity` (M,) is b(n) of eq. 4 (0 where never compared);
    `recent_means` (W, K, 3, 3) the last mean rotations; `converged` (K,) whose pose is settled.
    """

    controlled: FloatArray
    hypotheses: Hypotheses | None
    best_similarity: FloatArray
    recent_means: FloatArray
    converged: BoolArray


class PathInterpreter:
    """Path hypotheses on the view spheres of all candidates (Algorithm 1 and its three refinements)."""

    options_type = PathOptions
    state_type = PathState

    def __init__(
        self, models: Sequence[AspectGraph], descriptor: Descriptor, options: PathOptions | None = None
    ) -> None:
        self.candidates = Candidates.of(models)
        self.descriptor = descriptor
        self.options = options or PathOptions()

    def start(self) -> PathState:
        """No percept yet."""
        return PathState(
            controlled=np.empty((0, 3)),
            hypotheses=None,
            best_similarity=np.zeros(len(self.candidates.owner)),
            recent_means=np.empty((0, len(self.candidates.names), 3, 3)),
            converged=np.zeros(len(self.candidates.names), bool),
        )

    def update(self, state: PathState, percept: Percept) -> tuple[PathState, Interpretation]:
        """One iteration: grow the paths, rate them, keep the best N_hypo of every candidate."""
        if len(state.controlled) >= self.options.longest_path:
            state = self.start()
        controlled = np.concatenate([state.controlled, percept.view_direction[None]])
        if self._loop_free:
            controlled = without_loop(controlled, self.candidates.spacing_rad)
        hits, similarity, comparisons = self._grow(state.hypotheses, percept.feature)
        best_similarity = np.fmax(state.best_similarity, similarity)
        hypotheses = self._rate(hits, controlled, similarity, best_similarity)
        if len(controlled) > 1 and hypotheses.w1.min() > np.radians(self.options.lost_above_deg):
            return self.update(self.start(), percept)
        means = self._mean_rotations(hypotheses)
        recent = np.concatenate([state.recent_means, means[None]])[-WINDOW:]
        variance = running_variance(recent)
        converged = self._converged(state.converged, variance)
        after = PathState(controlled, hypotheses, best_similarity, recent, converged)
        return after, self._interpret(after, variance, hypotheses, percept.stamp_ns, comparisons)

    def hypotheses(self, state: PathState, stamp_ns: int) -> HypothesisViews:
        """The ends of all paths in the control frame; a path weighs as much as its place in the queues is good."""
        paths, names = state.hypotheses, tuple(self.candidates.names)
        if paths is None:
            return HypothesisViews(stamp_ns, names, np.empty(0, np.int64), np.empty((0, 3)), np.empty(0))
        ends = np.einsum("pij,pj->pi", paths.rotation, self.candidates.directions[paths.hits[:, -1]])
        weight = 1.0 / paths.rating
        return HypothesisViews(stamp_ns, names, self.owner(paths), ends, weight / weight.sum())

    def owner(self, hypotheses: Hypotheses) -> Array:
        """(P,) index of the candidate each hypothesis belongs to."""
        owner: Array = self.candidates.owner[hypotheses.hits[:, -1]]
        return owner

    @property
    def _loop_free(self) -> bool:
        return self.options.variant in ("loop_free", "accumulated")

    def _grow(self, hypotheses: Hypotheses | None, feature: Array) -> tuple[Array, FloatArray, int]:
        """New paths (C, H), similarity of the view to every node (M,) (nan where not compared), comparisons made."""
        nodes = len(self.candidates.owner)
        if hypotheses is None:
            similarity = self.descriptor.similarity(feature, self.candidates.features)
            return np.arange(nodes, dtype=np.int32)[:, None], similarity, nodes
        parent, node = children_of(hypotheses.hits, self.candidates)
        compared = np.unique(node)
        similarity = np.full(nodes, np.nan)
        similarity[compared] = self.descriptor.similarity(feature, self.candidates.features[compared])
        if self.options.variant == "initial":
            chosen = most_similar_child(parent, node, similarity)
            parent, node = parent[chosen], node[chosen]
        hits = grow(hypotheses.hits, parent, node, loop_free=self._loop_free)
        return hits, similarity, len(compared)

    def _rate(
        self, hits: Array, controlled: FloatArray, similarity: FloatArray, best_similarity: FloatArray
    ) -> Hypotheses:
        """Measure all paths, keep the best of every candidate, and rate those kept in queues of their own."""
        rotation = self._transform(hits, controlled)
        w1 = path_course(hits, rotation, self.candidates.directions, controlled)
        if self._loop_free:
            distinct = distinct_paths(hits, w1)
            hits, rotation, w1 = hits[distinct], rotation[distinct], w1[distinct]
        measured = Hypotheses(
            hits=hits,
            rotation=rotation,
            w0=similarity[hits[:, -1]],
            w1=w1,
            w2=accumulated_similarity(hits, best_similarity),
            rating=np.empty(len(hits)),
        )
        selection = _rating(measured, SELECTED_BY[self.options.variant])
        kept = measured.take(best_per_candidate(selection, measured.w1, self.owner(measured), self.options.hypotheses))
        rating = _rating(kept, self.options.rated_by or SELECTED_BY[self.options.variant])
        return Hypotheses(kept.hits, kept.rotation, kept.w0, kept.w1, kept.w2, rating)

    def _transform(self, hits: Array, controlled: FloatArray) -> FloatArray:
        """(C, 3, 3) transformation t_i of every path onto the controlled path."""
        directions, end = self.candidates.directions, arc_end(controlled)
        by_ends = align_start_and_end(directions[hits[:, 0]], directions[hits[:, end]], controlled[0], controlled[end])
        if self.options.alignment == "fig4":
            return by_ends
        return align_whole_path(np.einsum("hi,chj->cij", controlled, directions[hits]), by_ends)

    def _mean_rotations(self, hypotheses: Hypotheses) -> FloatArray:
        """(K, 3, 3) mean transformation over each candidate's hypotheses (section IV.E)."""
        owner = self.owner(hypotheses)
        return np.stack([mean_rotation(hypotheses.rotation[owner == k]) for k in range(len(self.candidates.names))])

    def _converged(self, before: BoolArray, variance: FloatArray) -> BoolArray:
        """(K,) whose pose has settled; one node more or less on the paths does not unsettle it."""
        limit = np.radians(1.0) ** 2 * self.options.variance_limit_deg2
        converged: BoolArray = (variance < limit) | (before & (variance < UNSETTLED * limit))
        return converged

    def _interpret(
        self, state: PathState, variance: FloatArray, hypotheses: Hypotheses, stamp_ns: int, comparisons: int
    ) -> Interpretation:
        owner = self.owner(hypotheses)
        best = [self._best(hypotheses, owner == k) for k in range(len(self.candidates.names))]
        ratings = hypotheses.rating[best]
        rivals = ratings <= self.options.plausible_within * ratings.min()
        plausible = rivals.copy()
        plausible[np.argsort(ratings, kind="stable")[:2]] = True  # the runner-up must be refuted by a view, not by luck
        estimate = Estimate(
            stamp_ns=stamp_ns,
            iteration=len(state.controlled),
            phase=Phase.EXPLORING,
            candidates=tuple(
                CandidateEstimate(
                    name=name,
                    rating=float(hypotheses.rating[b]),
                    w0=float(hypotheses.w0[b]),
                    w1=float(hypotheses.w1[b]),
                    w2=float(hypotheses.w2[b]),
                    rotation=state.recent_means[-1, k],
                    variance=float(variance[k]),
                    converged=bool(state.converged[k]),
                    hypotheses=int(np.count_nonzero(owner == k)),
                )
                for k, (name, b) in enumerate(zip(self.candidates.names, best, strict=True))
            ),
            comparisons=comparisons,
            travel_rad=0.0,
            target=None,
        )
        return Interpretation(
            estimate=estimate,
            rotations=state.recent_means[-1],
            converged=bool(state.converged[rivals].all()) or len(state.controlled) >= self.options.settle_within,
            plausible=plausible,
            leader=_leader(ratings, self.options.plausible_within),
            fresh=len(state.recent_means) < WINDOW,
        )

    def _best(self, hypotheses: Hypotheses, mine: Array) -> int:
        """Index of a candidate's best-rated hypothesis; of equal ones that with the better path course."""
        index = np.flatnonzero(mine)
        return int(index[np.lexsort((hypotheses.w1[index], hypotheses.rating[index]))[0]])


def _rating(hypotheses: Hypotheses, measures: Sequence[Measure]) -> FloatArray:
    """Mean queue position over the measures; similarities count from high to low, distances from low to high."""
    queues = {"w0": -hypotheses.w0, "w1": hypotheses.w1, "w2": -hypotheses.w2}
    return mean_position([queues[measure] for measure in measures])


def _leader(ratings: FloatArray, factor: float) -> int:
    """The candidate whose rating is `factor` times better than every other's (section V.B), or -1."""
    order = np.argsort(ratings, kind="stable")
    if len(order) > 1 and ratings[order[1]] < factor * ratings[order[0]]:
        return -1
    return int(order[0])
