"""What every candidate shows from everywhere, and how likely a look is there: learned from the candidates' trials."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from viewsep.interpretation.law import Law
from viewsep.interpretation.metric import HALVED, Metric, Residuals, embedded, residuals_of
from viewsep.interpretation.view_cells import CELLS, Interpolation, cell_directions
from viewsep.messages import Array, FloatArray
from viewsep.models.aspect_graph import AspectGraph

CALM, DISTURBED = 0, 1
TEMPERS = tuple(np.round(np.geomspace(0.05, 0.5, 12), 4))
TEMPERED_ON, NEAR_RAD = 240, np.radians(8.0)
KEPT = 32  # candidates whose views from everywhere are kept
STRANGE = 0.03  # of the looks at candidates fit them so badly that they are as likely to be at none of them


@dataclass(frozen=True, eq=False, slots=True)
class _Measured:
    """A model's residuals that had no part in the metric: squared lengths (R,), level (R,), cell (R,), looks (R, M).

    `worst2` (R,) are the squared lengths of those that were halved as if they had not been.
    """

    distance2: FloatArray
    worst2: FloatArray
    level: Array
    cell: Array
    looks: Array


@dataclass(frozen=True, eq=False, slots=True)
class Loan:
    """What candidate `lender` shows in cells `at` (C,), `borrower` is expected to show in `cells` (C,), unlearned."""

    borrower: int
    lender: int
    cells: Array
    at: Array


class Predictions:
    """All candidates' views as one matrix, and the law of looks at them.

    `laws` are those of looks as clean as the model's views, and of disturbed ones. Residuals of one look are not
    independent of each other, so evidence is tempered by `temper`, at which the trials' views are found with the
    probability that they are given. Half of the trials make the metric, the other half laws and temper.
    `log_of_others` is the tempered log-likelihood of any look at an object that is no candidate: as likely as the
    strangest looks at candidates. How others look cannot be learned from twins; how the candidates look at worst, can.
    `log_error2` is the variance of log-likelihoods of looks at the right view: by so much is a candidate's evidence
    wrong at every look. Candidates of the same `layout` have their views in the same places, where they err alike;
    photos, each with a light and a mask of its own, do not.
    """

    def __init__(self, models: Sequence[AspectGraph]) -> None:
        self.names = tuple(model.name for model in models)
        parts = [_interpolation(model) for model in models]
        residuals = [residuals_of(model, part) for model, part in zip(models, parts, strict=True)]
        self.metric = _metric(models, residuals)
        views = [self.metric.project(model.features) for model in models]
        self.views = np.concatenate(views)  # (N, M)
        self._views_norm2: Array = np.einsum("ne,ne->n", self.views, self.views)
        self.starts = np.cumsum([0, *(len(model.directions) for model in models[:-1])])
        self._counts = [len(model.directions) for model in models]
        self._connect(_edges_of(models, self.starts))
        self._node = np.stack([part.node + start for part, start in zip(parts, self.starts, strict=True)])
        self._weight = np.stack([part.weight for part in parts])
        self._covered = np.stack([part.covered for part in parts])
        self._lent: Array | None = None  # (K, CELLS) where it shows what another one does
        self._lenders = [{k} for k in range(len(models))]  # whose views a candidate shows
        self._shown: dict[int, Array] = {}  # of the candidates asked about latest, for it takes a megabyte each
        self._norm2 = np.stack([self._predicted_norm2(k) for k in range(len(models))])
        measured = [_measured(residual, self.metric) for residual in residuals]
        self.laws = _laws(measured, self.dimensions)
        self.temper = self._best_temper(measured)
        self.log_of_others = self._log_of_strange(measured)
        self.log_error2 = self._log_error2(measured)
        places: dict[bytes, int] = {}
        self.layout = np.array([places.setdefault(_layout_of(model), len(places)) for model in models])

    @property
    def dimensions(self) -> int:
        """M, of the projected features."""
        return int(self.metric.centre.size)

    @property
    def typical2(self) -> float:
        """The squared length of the residual of a typical clean look: by so much a model errs."""
        return self.dimensions * self.laws[CALM].scale2

    def project(self, feature: Array) -> Array:
        """(D,) -> (M,)."""
        (projected,) = self.metric.project(feature[None])
        return np.asarray(projected)

    def distance2(self, look: Array, candidates: Array) -> Array:
        """(M,) projected look and (A,) candidates -> (A, CELLS) squared distances to what they show in the cells."""
        product = np.empty(len(self.views), np.float32)
        for k in set().union(*(self._lenders[k] for k in candidates)):
            own = slice(self.starts[k], self.starts[k] + self._counts[k])
            np.dot(self.views[own], look, out=product[own])
        predicted = np.einsum("kcj,kcj->kc", self._weight[candidates], product[self._node[candidates]])
        distance2: Array = np.maximum(look @ look - 2.0 * predicted + self._norm2[candidates], 0.0)
        return distance2

    def log_likelihood(self, look: Array, candidates: Array, calm: float) -> Array:
        """(M,) projected look, (A,) candidates -> (A, CELLS) float32 tempered log-likelihoods.

        `calm` is the probability that looks are as clean as the models' views. Where a model has no view close enough,
        the look is as likely as one at any object; at least as likely where it shows what another one lends.
        """
        seen = self.log_of_distance2(self.distance2(look, candidates), calm)
        if self._lent is not None:
            np.maximum(seen, np.float32(self.log_of_others), out=seen, where=self._lent[candidates])
        return np.where(self._covered[candidates], seen, np.float32(self.log_of_others))

    def fit(self, nearest2: Array) -> Array:
        """(K,) squared distances to the most similar mixture of views -> (K,) how well it fits: 1 exactly, 0 not."""
        law = self.laws[DISTURBED]
        fit: Array = 1.0 / (1.0 + nearest2 / (law.dimensions * law.scale2))
        return fit

    def nearest2(self, look: Array) -> Array:
        """(M,) projected look -> (K,) squared distances to the lines between neighbouring views."""
        product, (a, b) = self.views @ look, self._edges.T
        of_a = self._views_norm2[a] - 2.0 * product[a]
        of_b = self._views_norm2[b] - 2.0 * product[b]
        share = np.clip(0.5 + (of_a - of_b) / (2.0 * self._edge_length2), 0.0, 1.0)
        distance2 = (1.0 - share) * of_a + share * of_b - share * (1.0 - share) * self._edge_length2
        nearest: Array = np.minimum.reduceat(distance2, self._edge_starts) + look @ look
        return np.maximum(nearest, 0.0)

    def resembling(self, candidate: int, count: int) -> Array:
        """(A,) others with a view as close to one of about `count` of this one's as neighbours are, closest first."""
        own = self.views[self.starts[candidate] :][: self._counts[candidate]]
        asked = own[:: max(1, len(own) // count)]
        distance2 = self._views_norm2[:, None] - self.views @ (2.0 * asked).T + np.einsum("qe,qe->q", asked, asked)
        nearest2 = np.minimum.reduceat(distance2, self.starts).min(axis=1)
        edges = np.diff(self._edge_starts, append=len(self._edges))
        apart = nearest2 * edges / np.add.reduceat(self._edge_length2, self._edge_starts)  # in steps between neighbours
        apart[candidate] = np.inf
        order = np.argsort(apart, kind="stable")
        return np.asarray(order[apart[order] < 1.0])

    def disturbance(self, look: Array, candidate: int, cell: int) -> float:
        """The logarithm of how much more likely a look is as a disturbed one than as a clean one, from a cell."""
        shown = self.prediction(candidate, np.array([cell]))[0]
        distance2 = np.atleast_1d((look - shown) @ (look - shown))
        calm, disturbed = (float(law.log(distance2)[0]) for law in self.laws)
        return self.temper * (disturbed - calm)

    def prediction(self, candidate: int, cells: Array) -> Array:
        """(...) cells -> (..., M) what a candidate shows there."""
        if candidate not in self._shown:
            if len(self._shown) >= KEPT:
                del self._shown[next(iter(self._shown))]
            self._shown[candidate] = self._everywhere(candidate)
        shown: Array = np.take(self._shown[candidate], cells, axis=0)
        return shown

    def _everywhere(self, candidate: int) -> Array:
        """(CELLS, M) what a candidate shows."""
        shown: Array = np.einsum("nj,nje->ne", self._weight[candidate], self.views[self._node[candidate]])
        return shown

    def log_at(self, looks: Array, candidate: int, cells: Array) -> FloatArray:
        """(L, M) projected looks and (J, L) cells they may be from -> (J, L) tempered log-likelihoods of any looks."""
        among = np.zeros(CELLS, bool)
        among[cells] = True
        distinct, place = np.flatnonzero(among), (np.cumsum(among) - 1)[cells]
        product = looks @ self.prediction(candidate, distinct).T
        distance2 = (looks * looks).sum(axis=1)[:, None] - 2.0 * product + self._norm2[candidate, distinct]
        at = np.take_along_axis(distance2, place.T, axis=1).T
        seen = self.log_of_distance2(np.maximum(at, 0.0), 0.5).astype(np.float64)
        if self._lent is not None:
            np.maximum(seen, self.log_of_others, out=seen, where=self._lent[candidate, cells])
        return np.where(self.known(candidate, cells), seen, self.log_of_others)

    def known(self, candidate: int, cells: Array) -> Array:
        """(...) cells -> (...) bool: whether the candidate has views there."""
        covered: Array = self._covered[candidate, cells]
        return covered

    def log_of_distance2(self, distance2: Array, calm: float) -> Array:
        """(...) squared distances -> (...) tempered log-likelihoods; `calm` is the probability of a clean look."""
        clean, disturbed = (
            np.float32(np.log(max(share, 1e-12))) + law.log(distance2)
            for law, share in zip(self.laws, (calm, 1.0 - calm), strict=True)
        )
        apart = np.abs(clean - disturbed)
        mixed: Array = np.float32(self.temper) * (np.maximum(clean, disturbed) + np.log1p(np.exp(-apart)))
        return mixed

    def _connect(self, edges: Sequence[Array]) -> None:
        """Every candidate's (E, 2) neighbouring views, at least one pair."""
        self._edges: Array = np.concatenate(edges)
        self._edge_starts = np.cumsum([0, *(len(part) for part in edges[:-1])])
        apart = self.views[self._edges[:, 0]] - self.views[self._edges[:, 1]]
        self._edge_length2: Array = np.maximum(np.einsum("ne,ne->n", apart, apart), np.float32(1e-12))

    def borrowing(self, loans: Sequence[Loan]) -> Predictions:
        """The same where candidates have views; elsewhere they may show what others lend them, or anything."""
        filled = copy(self)
        filled._node, filled._weight = self._node.copy(), self._weight.copy()
        filled._covered, filled._norm2 = self._covered.copy(), self._norm2.copy()
        filled._lent = np.zeros_like(self._covered)
        filled._lenders, filled._shown = [set(own) for own in self._lenders], {}
        for loan in loans:
            filled._node[loan.borrower, loan.cells] = self._node[loan.lender, loan.at]
            filled._weight[loan.borrower, loan.cells] = self._weight[loan.lender, loan.at]
            filled._covered[loan.borrower, loan.cells] = filled._lent[loan.borrower, loan.cells] = True
            filled._lenders[loan.borrower].add(loan.lender)
        for k in {loan.borrower for loan in loans}:
            filled._norm2[k] = filled._predicted_norm2(k)
        edges = np.split(self._edges, self._edge_starts[1:])
        for loan in loans:
            shown = np.isin(edges[loan.lender], self._node[loan.lender, loan.at]).all(axis=1)
            edges[loan.borrower] = np.concatenate([edges[loan.borrower], edges[loan.lender][shown]])
        filled._connect(edges)
        return filled

    def _predicted_norm2(self, k: int) -> Array:
        """(CELLS,) squared length of the mixtures, which are shorter than the features they are made of."""
        shown = self._everywhere(k)
        norm2: Array = np.einsum("ne,ne->n", shown, shown)
        return norm2

    def _log_of_strange(self, measured: Sequence[_Measured]) -> float:
        """The tempered log-likelihood that the strangest of clean looks, or of disturbed ones if less, do not reach."""
        log = np.concatenate([self.log_of_distance2(one.worst2, 0.5) for one in measured])
        level = np.concatenate([one.level for one in measured])
        return min(float(np.quantile(log[level == kind], STRANGE)) for kind in np.unique(level))

    def _log_error2(self, measured: Sequence[_Measured]) -> float:
        """The variance within clean and within disturbed looks."""
        log = np.concatenate([self.log_of_distance2(one.distance2, 0.5) for one in measured])
        level = np.concatenate([one.level for one in measured])
        means = np.array([log[level == kind].mean() if (level == kind).any() else 0.0 for kind in (CALM, DISTURBED)])
        return float(((log - means[level]) ** 2).mean())

    def _best_temper(self, measured: Sequence[_Measured]) -> float:
        """The power of the likelihood at which the trials' true views are the most probable ones."""
        total = np.zeros(len(TEMPERS))
        each = max(1, TEMPERED_ON // len(measured))
        for k in np.unique(np.linspace(0, len(measured) - 1, min(len(measured), TEMPERED_ON)).astype(int)):
            one = measured[k]
            for r in np.unique(np.linspace(0, len(one.level) - 1, min(each, len(one.level))).astype(int)):
                law = self.laws[one.level[r]]
                log = law.log(self.distance2(one.looks[r], np.array([k]))[0])
                near = cell_directions() @ cell_directions()[one.cell[r]] > np.cos(NEAR_RAD)
                powers = np.outer(TEMPERS, np.where(self._covered[k], log - log.max(), -np.inf))
                found = np.exp(powers)
                total += np.log(np.maximum(found[:, near].sum(axis=1) / found.sum(axis=1), 1e-6))
        return float(TEMPERS[int(np.argmax(total))])


def _layout_of(model: AspectGraph) -> bytes:
    """The same for models that err alike. Those from photos, which have trials at their views, are each its own."""
    photographed = model.trials is not None and bool((model.trials.directions == model.directions[0]).all(axis=1).any())
    return model.directions.tobytes() + (model.name.encode() if photographed else b"")


_INTERPOLATIONS: dict[bytes, Interpolation] = {}


def _interpolation(model: AspectGraph) -> Interpolation:
    """Models with the same views share it: finding it takes longer than a look."""
    key = model.directions.tobytes() + model.edges.tobytes()
    if key not in _INTERPOLATIONS:
        if len(_INTERPOLATIONS) >= 64:
            _INTERPOLATIONS.clear()
        _INTERPOLATIONS[key] = Interpolation.of(model)
    return _INTERPOLATIONS[key]


def _metric(models: Sequence[AspectGraph], residuals: Sequence[Residuals]) -> Metric:
    """From all views and every other residual, or as many as are needed of a large library."""
    every = max(1, len(models) // 50)
    views = np.concatenate([embedded(model.features[:: min(every, 20)]) for model in models])
    errors = [(one.looks - one.predicted)[:: 2 * min(every, 20)] for one in residuals]
    return Metric.fit(views, np.concatenate(errors))


def _measured(residuals: Residuals, metric: Metric) -> _Measured:
    odd = slice(1, None, 2)
    looks, predicted = (part[odd] @ metric.projection for part in (residuals.looks, residuals.predicted))
    distance2 = ((looks - predicted) ** 2).sum(axis=1).astype(np.float64)
    worst2 = np.where(residuals.halved[odd], distance2 / HALVED**2, distance2)
    return _Measured(
        distance2, worst2, residuals.disturbed[odd].astype(int), residuals.cell[odd], looks - metric.centre
    )


def _laws(measured: Sequence[_Measured], dimensions: int) -> tuple[Law, Law]:
    """Of clean and of disturbed looks; where there are none of a kind, as the other kind."""
    distance2 = np.concatenate([one.distance2 for one in measured])
    level = np.concatenate([one.level for one in measured])
    found = [distance2[level == kind] for kind in (CALM, DISTURBED)]
    calm, disturbed = (Law.fit(part if len(part) else distance2, dimensions) for part in found)
    return calm, disturbed


def _edges_of(models: Sequence[AspectGraph], starts: Array) -> list[Array]:
    """(E, 2) neighbouring views of each model, among those of all; a view alone is its own neighbour."""
    return [
        start + (model.edges if len(model.edges) else np.repeat(np.arange(len(model.directions))[:, None], 2, axis=1))
        for model, start in zip(models, starts, strict=True)
    ]
