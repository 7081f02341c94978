"""What models predict from everywhere, and how likely looks are there, learned from trials of known noise."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from painted import NODES, TWIN, model, noisy, painted, ring_model, unit

from viewsep.geometry import angle_between, axis_rotation
from viewsep.interpretation.predictions import CALM, DISTURBED, STRANGE, TEMPERS, Predictions
from viewsep.interpretation.unlearned import predictions_of
from viewsep.interpretation.view_cells import CELLS, cell_directions, cell_of
from viewsep.messages import Array, FloatArray
from viewsep.trials import trial_directions

BOTH = np.arange(2)
ANYWHERE = unit(np.random.default_rng(3).normal(size=(20, 3)))


@cache
def learned(noise: float = 0.1, disturbed: float = 0.5) -> Predictions:
    """Two different objects, learned with trials."""
    return predictions_of(
        tuple(model(name, paint, noise=noise, disturbed=disturbed) for name, paint in (("a", 1), ("b", 2)))
    )


def look_at(predictions: Predictions, view: FloatArray, paint: int) -> Array:
    return predictions.project(painted(view[None], paint)[0])


def cell_at(view: FloatArray) -> int:
    return int(cell_of(*view[:, None])[0])


def test_the_likelihood_is_highest_where_the_feature_was_seen() -> None:
    predictions = Predictions([model("a", 1), model("b", 2)])
    rng = np.random.default_rng(3)
    for _ in range(20):
        view = unit(rng.normal(size=3))
        look = predictions.project(painted(view[None], 1)[0])
        likelihood = predictions.log_likelihood(look, np.arange(2), 0.5)
        owner, cell = np.unravel_index(np.argmax(likelihood), likelihood.shape)
        assert owner == 0
        assert np.degrees(angle_between(cell_directions()[cell], view)) < 12.0


def test_distances_are_those_to_what_is_predicted() -> None:
    predictions = learned()
    look = look_at(predictions, ANYWHERE[0], 1)
    found = predictions.distance2(look, BOTH)
    assert found.shape == (2, CELLS)
    for candidate in range(2):
        shown = predictions.prediction(candidate, np.arange(CELLS))
        np.testing.assert_allclose(found[candidate], ((shown - look) ** 2).sum(axis=1), rtol=1e-3, atol=0.02)
    np.testing.assert_array_equal(predictions.distance2(look, BOTH[1:]), found[1:])


def test_what_is_predicted_at_a_view_is_the_view() -> None:
    predictions = learned()
    for node in (0, 50, 99):
        (shown,) = predictions.prediction(1, np.array([cell_at(NODES[node])]))
        itself, far = (predictions.project(painted(view[None], 2)[0]) for view in (NODES[node], -NODES[node]))
        assert np.linalg.norm(shown - itself) < 0.15 * np.linalg.norm(shown - far)


def test_likelihoods_of_some_candidates_are_those_among_all() -> None:
    predictions = learned()
    look = look_at(predictions, ANYWHERE[1], 2)
    np.testing.assert_array_equal(
        predictions.log_likelihood(look, BOTH[1:], 0.3), predictions.log_likelihood(look, BOTH, 0.3)[1:]
    )


# ---- laws ----


def test_disturbed_looks_have_the_wider_law_where_they_are_noisier() -> None:
    calm, disturbed = learned(noise=0.1, disturbed=0.5).laws
    assert disturbed.scale2 > 4.0 * calm.scale2
    calm, disturbed = learned(noise=0.3, disturbed=0.3).laws
    assert disturbed.scale2 == pytest.approx(calm.scale2, rel=0.4)


def test_without_trials_both_laws_are_the_same() -> None:
    predictions = predictions_of((model("a", 1), model("b", 2)))
    assert predictions.laws[CALM] == predictions.laws[DISTURBED]


def lost_by_noise(predictions: Predictions, noise: float) -> float:
    """By how much noise makes a look less likely where it was taken, before tempering, on average."""
    lost = []
    for seed, view in enumerate(ANYWHERE):
        clean = painted(view[None], 1)
        logs = [
            predictions.log_likelihood(predictions.project(seen[0]), BOTH, 0.9)[0, cell_at(view)]
            for seen in (clean, noisy(clean, noise, seed))
        ]
        lost.append((logs[0] - logs[1]) / predictions.temper)
    return float(np.mean(lost))


def test_learned_from_noisier_trials_a_noisy_look_is_less_of_a_surprise() -> None:
    careful, careless = (lost_by_noise(learned(noise, noise), 0.5) for noise in (0.05, 0.5))
    assert careful > 3.0 * careless > 0.0


def test_a_clean_look_speaks_for_calm_and_a_spoilt_one_against_it() -> None:
    predictions = learned(noise=0.1, disturbed=0.5)
    for seed, view in enumerate(ANYWHERE):
        clean = painted(NODES[seed][None], 1)
        assert predictions.disturbance(predictions.project(clean[0]), 0, cell_at(NODES[seed])) < 0.0
        spoilt = noisy(painted(view[None], 1), 1.5, seed)
        assert predictions.disturbance(predictions.project(spoilt[0]), 0, cell_at(view)) > 0.0


def test_the_surer_one_is_of_calm_looks_the_less_a_spoilt_one_is_likely() -> None:
    predictions, view = learned(noise=0.1, disturbed=0.5), ANYWHERE[4]
    spoilt = predictions.project(noisy(painted(view[None], 1), 1.0, 1)[0])
    at = [predictions.log_likelihood(spoilt, BOTH, calm)[0, cell_at(view)] for calm in (0.02, 0.5, 0.98)]
    assert at[0] > at[1] > at[2]


# ---- other objects ----


@pytest.mark.parametrize("noise", [None, 0.05])
def test_a_look_is_best_explained_by_its_object_then_by_an_unknown_one_then_by_another(noise: float | None) -> None:
    library = [model(f"m{k}", 20 + k, noise=noise, disturbed=noise or 0.0) for k in range(8)]
    predictions, candidates = Predictions(library), np.arange(8)
    of_own = [look_at(predictions, view, 20) for view in ANYWHERE]
    own = [
        predictions.log_likelihood(look, candidates, 0.5)[0, cell_at(view)] - predictions.log_of_others
        for look, view in zip(of_own, ANYWHERE, strict=True)
    ]
    assert min(own) > 0.0
    assert np.mean(own) > 5.0
    of_foreign = [look_at(predictions, view, 60) for view in ANYWHERE]
    best = [float(predictions.log_likelihood(look, candidates, 0.5).max()) for look in of_foreign]
    assert np.mean(predictions.log_of_others > np.array(best)) >= 0.9
    assert predictions.log_of_others > np.mean(best) + 5.0


def test_only_the_strangest_looks_at_candidates_are_likelier_to_be_at_none_of_them() -> None:
    library = [model(f"m{k}", 20 + k, noise=0.05, disturbed=0.3) for k in range(8)]
    predictions = Predictions(library)
    strange = []
    for k in range(8):
        views = trial_directions(200)[100:]
        looks = predictions.metric.project(noisy(painted(views, 20 + k), 0.3, 900 + k))
        own = [
            predictions.log_likelihood(look, np.array([k]), 0.5)[0, cell_at(view)]
            for look, view in zip(looks, views, strict=True)
        ]
        strange += [float(log) < predictions.log_of_others for log, look in zip(own, looks, strict=True)]
    assert 0.3 * STRANGE < np.mean(strange) < 3.0 * STRANGE


def test_twins_too_know_a_look_at_another_object() -> None:
    twins = Predictions([model("a", 1, noise=0.05, disturbed=0.3), model("b", 1, TWIN, noise=0.05, disturbed=0.3)])
    foreign = [look_at(twins, view, 60) for view in ANYWHERE]
    stranger = [twins.log_of_others > twins.log_likelihood(look, BOTH, 0.5).max() for look in foreign]
    assert np.mean(stranger) >= 0.9


def test_where_a_model_has_no_view_a_look_is_as_likely_as_at_any_object() -> None:
    predictions = Predictions([ring_model("a", 1), ring_model("b", 2)])
    height = np.abs(cell_directions()[:, 2])
    look = look_at(predictions, unit(np.array([1.0, 0.2, 0.0])), 1)
    likelihood = predictions.log_likelihood(look, BOTH, 0.5)
    known = predictions.known(0, np.arange(CELLS))
    assert known[height < 0.1].all()
    assert not known[height > 0.4].any()
    assert (likelihood[:, ~known] == np.float32(predictions.log_of_others)).all()
    assert (likelihood[:, known] != np.float32(predictions.log_of_others)).mean() > 0.99
    assert likelihood[0, known].max() > predictions.log_of_others


def test_the_fit_is_one_for_a_view_itself_and_falls_with_the_difference() -> None:
    predictions = learned()
    itself = predictions.fit(predictions.nearest2(predictions.views[7]))  # of candidate 0
    assert itself[0] == pytest.approx(1.0, abs=1e-3)
    foreign = np.array([predictions.fit(predictions.nearest2(look_at(predictions, view, 9))) for view in ANYWHERE])
    near = np.array([predictions.fit(predictions.nearest2(look_at(predictions, view, 2))) for view in ANYWHERE])
    assert ((foreign > 0.0) & (foreign < 1.0)).all()
    assert near[:, 1].min() > foreign.mean()
    assert near[:, 1].mean() > 2.0 * near[:, 0].mean()


def test_the_most_similar_view_is_rated_as_the_likelihood_rates_it() -> None:
    predictions = predictions_of((model("a", 1), model("b", 2)))
    for node in (3, 60):
        likelihood = predictions.log_of_distance2(predictions.nearest2(predictions.views[node]), 0.5)
        same = predictions.log_of_distance2(predictions.nearest2(predictions.views[100 + node]), 0.5)
        assert likelihood[0] > likelihood[1]
        assert same[1] > same[0]
        assert likelihood[0] == pytest.approx(same[1], rel=1e-3)  # nothing is off, at either


# ---- all of them ----


@pytest.mark.parametrize("noise", [0.02, 0.5])
def test_the_temper_is_one_of_those_tried(noise: float) -> None:
    assert learned(noise, noise).temper in TEMPERS


def test_views_that_are_found_elsewhere_temper_the_evidence() -> None:
    """The trials of the second are of looks 12 degrees beside: that they point there surely must not be believed."""
    good = model("a", 1, noise=0.1, disturbed=0.1)
    assert good.trials is not None
    beside = axis_rotation(np.array([1.0, 0.0, 0.0]), np.radians(12.0))
    astray = replace(good, trials=replace(good.trials, directions=good.trials.directions @ beside))
    assert Predictions([astray]).temper < Predictions([good]).temper


def test_predictions_of_the_same_models_are_shared() -> None:
    a, b, c = model("a", 1), model("b", 2), model("c", 3)
    shared = predictions_of((a, b))
    assert predictions_of((a, b)) is shared
    assert predictions_of((a, c)) is not shared


def test_the_order_of_the_candidates_changes_nothing() -> None:
    a, b = (model(name, paint, noise=0.1, disturbed=0.3) for name, paint in (("a", 1), ("b", 2)))
    one, other = Predictions([a, b]), Predictions([b, a])
    assert other.names == ("b", "a")
    assert other.temper == one.temper
    for view in ANYWHERE[:5]:
        likelihoods = [p.log_likelihood(look_at(p, view, 1), BOTH, 0.5) for p in (one, other)]
        np.testing.assert_allclose(likelihoods[0], likelihoods[1][::-1], rtol=0.02, atol=0.05)


def test_models_with_different_views_can_be_candidates_together() -> None:
    predictions = Predictions([ring_model("a", 1), model("b", 2)])
    assert predictions.starts.tolist() == [0, 24]
    assert len(predictions.views) == 124
    view = unit(np.array([0.3, 0.8, 0.0]))  # on the ring: beside it, the ring knows nothing
    for candidate, paint in ((0, 1), (1, 2)):
        likelihood = predictions.log_likelihood(look_at(predictions, view, paint), BOTH, 0.5)
        owner, cell = np.unravel_index(np.argmax(likelihood), likelihood.shape)
        assert owner == candidate
        assert np.degrees(angle_between(cell_directions()[cell], view)) < 15.0
