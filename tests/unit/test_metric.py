"""The metric keeps what tells views apart and suppresses how looks at the same view differ."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from painted import NODES, model, noisy, painted

from viewsep.interpretation.metric import DIMENSIONS, Metric, embedded, residuals_of
from viewsep.interpretation.view_cells import Interpolation, cell_of
from viewsep.messages import Array, FloatArray

NUISANCE, TELLING = slice(0, 5), slice(5, 10)  # directions in which looks differ, and in which they do not


def embedded_looks(seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Views (400, 10) that differ everywhere, residuals (400, 10) that are large in the first directions."""
    rng = np.random.default_rng(seed)
    size = np.ones(10)
    size[NUISANCE], size[TELLING] = 2.0, 0.1
    return rng.normal(size=(400, 10)), rng.normal(size=(400, 10)) * size


def squared(metric: Metric, difference: FloatArray) -> FloatArray:
    projected = difference @ metric.projection
    lengths: FloatArray = (projected**2).sum(axis=-1)
    return lengths


def test_residuals_have_about_unit_variance_where_they_are_large_and_less_elsewhere() -> None:
    views, residuals = embedded_looks()
    metric = Metric.fit(views, residuals)
    assert metric.projection.shape == (10, 10)
    projected = residuals @ metric.projection
    covariance = projected.T @ projected / len(projected)
    variance = np.sort(np.diag(covariance))
    assert variance[5:] == pytest.approx(1.0, abs=0.25)
    assert variance[:5].max() < 0.25  # the rest is taken to vary as the views do
    assert np.abs(covariance - np.diag(np.diag(covariance))).max() < 0.1


def test_directions_of_residuals_are_suppressed_and_differences_of_views_kept() -> None:
    metric = Metric.fit(*embedded_looks())
    axes = np.eye(10)
    assert squared(metric, axes[TELLING]).min() > 8.0 * squared(metric, axes[NUISANCE]).max()


def test_the_first_direction_tells_the_most() -> None:
    views, residuals = embedded_looks()
    metric = Metric.fit(views, residuals)
    variance = (views @ metric.projection).var(axis=0)
    assert (np.diff(variance) <= 1e-4 * variance[0]).all()
    assert variance[0] > 3.0 * variance[-1]


def test_no_more_directions_than_needed_are_kept_and_those_that_tell_the_most() -> None:
    rng = np.random.default_rng(1)
    views, residuals = rng.normal(size=(300, DIMENSIONS + 40)), rng.normal(size=(300, DIMENSIONS + 40))
    views[:, DIMENSIONS:] *= 0.1
    metric = Metric.fit(views, residuals)
    assert metric.projection.shape == (DIMENSIONS + 40, DIMENSIONS)
    axes = np.eye(DIMENSIONS + 40)
    assert squared(metric, axes[:DIMENSIONS]).min() > 2.0 * squared(metric, axes[DIMENSIONS:]).max()


def test_it_does_not_depend_on_the_order() -> None:
    views, residuals = embedded_looks()
    rng = np.random.default_rng(3)
    metric = Metric.fit(views, residuals)
    other = Metric.fit(rng.permutation(views), rng.permutation(residuals))
    differences = rng.normal(size=(50, 10))
    np.testing.assert_allclose(squared(other, differences), squared(metric, differences), rtol=1e-3)


def test_fewer_looks_than_dimensions_give_a_finite_metric_too() -> None:
    rng = np.random.default_rng(4)
    metric = Metric.fit(rng.normal(size=(6, 40)), rng.normal(size=(5, 40)))
    assert metric.projection.shape[1] <= 11
    assert np.isfinite(metric.projection).all()


def test_the_mean_view_lies_in_the_middle() -> None:
    views = embedded(painted(NODES, 1))
    metric = Metric.fit(views, views - embedded(noisy(painted(NODES, 1), 0.2, 1)))
    assert np.abs(metric.project(painted(NODES, 1)).mean(axis=0)).max() < 1e-3
    assert np.abs(metric.project(painted(NODES, 1))).max() > 1.0


def test_similarity_of_embedded_histograms_is_bhattacharyyas_coefficient() -> None:
    histograms = painted(NODES, 1)[:3]
    once = embedded(histograms)
    np.testing.assert_allclose(np.linalg.norm(once, axis=1), 1.0, rtol=1e-6)
    assert float(once[0] @ once[1]) == pytest.approx(float(np.sqrt(histograms[0] * histograms[1]).sum()), rel=1e-5)
    np.testing.assert_allclose(embedded(7.0 * histograms), once, rtol=1e-6)
    np.testing.assert_array_equal(embedded(np.zeros((1, 4), np.float32)), np.zeros((1, 4)))


# ---- residuals of models ----


def half_way(node: int, edges: Array, views: Array) -> FloatArray:
    """Between a view and the mean of its neighbours."""
    near = [int(b if a == node else a) for a, b in edges if node in (a, b)]
    middle: FloatArray = 0.5 * (views[node] + views[near].mean(axis=0))
    return middle


def test_without_trials_residuals_are_those_of_views_from_their_neighbours() -> None:
    whole = model("a", 1)
    found = residuals_of(whole, Interpolation.of(whole))
    views = embedded(whole.features)
    np.testing.assert_array_equal(found.looks, views)
    for node in (0, 42, 99):
        np.testing.assert_allclose(found.predicted[node], half_way(node, whole.edges, views), rtol=1e-4)
    assert not found.disturbed.any()
    np.testing.assert_array_equal(found.cell, cell_of(*NODES.T))


def test_a_view_without_neighbours_has_no_residual() -> None:
    whole = model("a", 1)
    alone = replace(whole, edges=whole.edges[(whole.edges != 7).all(axis=1)])
    found = residuals_of(alone, Interpolation.of(whole))
    np.testing.assert_array_equal(found.cell, np.delete(cell_of(*NODES.T), 7))


def test_residuals_of_trials_are_from_what_the_views_predict_there() -> None:
    whole = model("a", 1, noise=0.1, disturbed=0.4)
    assert whole.trials is not None
    part = Interpolation.of(whole)
    found = residuals_of(whole, part)
    np.testing.assert_array_equal(found.looks, embedded(whole.trials.features))
    np.testing.assert_array_equal(found.disturbed, whole.trials.disturbed)
    views = embedded(whole.features)
    for r in (0, 33, 119):
        cell = int(cell_of(*whole.trials.directions[r][:, None])[0])
        shown = part.weight[cell] @ views[part.node[cell]]
        np.testing.assert_allclose(found.predicted[r], shown, atol=1e-6)
        assert found.cell[r] == cell


def test_where_all_trials_are_disturbed_clean_residuals_are_those_of_the_views() -> None:
    whole = model("a", 1, noise=0.1, disturbed=0.4)
    assert whole.trials is not None
    worse = whole.trials.disturbed
    trials = replace(
        whole.trials,
        directions=whole.trials.directions[worse],
        features=whole.trials.features[worse],
        disturbed=worse[worse],
    )
    found = residuals_of(replace(whole, trials=trials), Interpolation.of(whole))
    assert found.disturbed.sum() == worse.sum()
    np.testing.assert_array_equal(found.looks[~found.disturbed], embedded(whole.features))
