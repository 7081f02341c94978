"""What of a feature tells views and objects apart, and what is only light, noise and error between the views.

Features are embedded so that similarity is an inner product, and then projected to where the views of all candidates
differ most in comparison to looks at the same view (Fisher's linear discriminants). A look's residual is its difference
from what a model predicts there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from viewsep.interpretation.view_cells import Interpolation, cell_of
from viewsep.messages import Array, BoolArray
from viewsep.models.aspect_graph import AspectGraph

DIMENSIONS = 64  # kept at most
ROWS = 700  # views, and residuals, that the discriminants are found from at most
SHRUNK, LIKE_VIEWS = 0.1, 0.9  # few residuals do not fill the space: the rest is taken to vary as the views do
HALVED = 0.5  # a residual of a view from its neighbours, as one between them would be: half as far away


@dataclass(frozen=True, eq=False, slots=True)
class Residuals:
    """`looks` (R, E) embedded and what the model predicts there, `predicted` (R, E); `disturbed` (R,); `cell` (R,).

    `halved` (R,) says whose difference from the prediction was halved.
    """

    looks: Array
    predicted: Array
    disturbed: BoolArray
    cell: Array
    halved: BoolArray


@dataclass(frozen=True, eq=False, slots=True)
class Metric:
    """`projection` (E, M) float32 and the `centre` (M,) of all views after it."""

    projection: Array
    centre: Array

    def project(self, features: Array) -> Array:
        """(N, D) features -> (N, M) float32."""
        projected: Array = embedded(features) @ self.projection
        return projected - self.centre

    @staticmethod
    def fit(views: Array, residuals: Array) -> Metric:
        """From embedded views (N, E) and residuals (R, E)."""
        views, residuals = _thinned(views), _thinned(residuals)
        centre = views.mean(axis=0)
        basis = _basis(np.concatenate([views - centre, residuals]))
        spread = (views - centre) @ basis
        error = residuals @ basis
        between = spread.T @ spread / len(spread)
        whitening = np.linalg.inv(np.linalg.cholesky(_shrunk(error.T @ error / len(error), between)))
        _, directions = np.linalg.eigh(whitening @ between @ whitening.T)
        projection = basis @ whitening.T @ directions[:, ::-1][:, :DIMENSIONS]
        projection = np.ascontiguousarray(projection, np.float32)
        return Metric(projection, (centre.astype(np.float32) @ projection))


def embedded(features: Array) -> Array:
    """(N, D) histograms -> (N, D) float32 of length 1, whose inner product is Bhattacharyya's coefficient."""
    roots: Array = np.sqrt(np.maximum(features, 0.0), dtype=np.float32)
    length = np.linalg.norm(roots, axis=1, keepdims=True)
    return roots / np.where(length > 0, length, 1.0).astype(np.float32)


def residuals_of(model: AspectGraph, interpolation: Interpolation) -> Residuals:
    """How looks at the object differ from what its model predicts: of its trials, and of views from their neighbours.

    The latter only where no trial lies between the views, as in models from photos.
    """
    views = embedded(model.features)
    parts = []
    trials = model.trials
    if trials is not None and len(trials.directions):
        cell = cell_of(*trials.directions.T)
        shown = np.einsum("rj,rje->re", interpolation.weight[cell], views[interpolation.node[cell]])
        tried = embedded(trials.features)
        parts.append(Residuals(tried, shown, trials.disturbed, cell, np.zeros(len(tried), bool)))
    if trials is None or trials.disturbed.all():
        parts.append(_left_out(model, views))
    return Residuals(
        np.concatenate([part.looks for part in parts]),
        np.concatenate([part.predicted for part in parts]),
        np.concatenate([part.disturbed for part in parts]),
        np.concatenate([part.cell for part in parts]),
        np.concatenate([part.halved for part in parts]),
    )


def _left_out(model: AspectGraph, views: Array) -> Residuals:
    """Every view and what lies half way from it to the mean of its neighbours."""
    adjacent = np.zeros((len(views), len(views)), np.float32)
    adjacent[model.edges[:, 0], model.edges[:, 1]] = 1.0
    adjacent += adjacent.T
    degree = adjacent.sum(axis=1)
    known = degree > 0
    mean = adjacent[known] @ views / degree[known, None]
    looks = views[known]
    half_way = looks + np.float32(HALVED) * (mean - looks)
    cell, clean, halved = cell_of(*model.directions[known].T), np.zeros(len(looks), bool), np.ones(len(looks), bool)
    return Residuals(looks, half_way, clean, cell, halved)


def _shrunk(within: Array, between: Array) -> Array:
    """The covariance of residuals (Q, Q), part of it replaced by what is like the views' and by the same everywhere."""
    total, same = float(np.trace(within)), np.eye(len(within)) / len(within)
    prior = LIKE_VIEWS * between / max(float(np.trace(between)), 1e-12) + (1.0 - LIKE_VIEWS) * same
    shrunk: Array = (1.0 - SHRUNK) * within + (SHRUNK * total + 1e-12) * prior + 1e-12 * same
    return shrunk


def _thinned(rows: Array) -> Array:
    """(N, E) -> at most ROWS of them, evenly spread, float64."""
    chosen = np.unique(np.linspace(0, len(rows) - 1, min(ROWS, len(rows))).astype(int))
    return np.asarray(rows[chosen], np.float64)


def _basis(rows: Array) -> Array:
    """(N, E) -> (E, Q) orthonormal, spanning the rows, by the smaller of the two Gram matrices."""
    if len(rows) < rows.shape[1]:
        values, vectors = np.linalg.eigh(rows @ rows.T)
        kept = values > 1e-9 * values[-1]
        spanning: Array = rows.T @ (vectors[:, kept] / np.sqrt(values[kept]))
        return spanning
    values, vectors = np.linalg.eigh(rows.T @ rows)
    basis: Array = vectors[:, values > 1e-9 * values[-1]]
    return basis
