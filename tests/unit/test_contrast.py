"""How much looks tell two candidates apart whose models err between their views."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from painted import (
    EDGES,
    NODES,
    POLE,
    TWIN,
    elsewhere,
    graph,
    held,
    interpreter,
    looks,
    model,
    noisy,
    painted,
    ring_model,
    seen,
    unit,
)
from scipy.special import expit

from viewsep.interpretation.contrast import contrast, moderated
from viewsep.interpretation.filter_state import FilterOptions
from viewsep.interpretation.predictions import Predictions
from viewsep.interpretation.view_cells import cell_of
from viewsep.messages import FloatArray
from viewsep.models.aspect_graph import AspectGraph, Trials

CLOSED = FilterOptions(unknown_prior=0.0)


def towards(side: float, count: int) -> FloatArray:
    """Views of the side where a twin differs (1), or of the other one (-1)."""
    views = unit(np.random.default_rng(4).normal(size=(400, 3)))
    chosen: FloatArray = views[side * views @ POLE > 0.55][:count]
    return chosen


def told(predictions: Predictions, views: FloatArray, paint: int, twin: float = 0.0) -> tuple[float, float]:
    """The evidence of looks at a painted object, for the first model against the second."""
    shown = predictions.metric.project(noisy(painted(views, paint, twin), 0.05, 8))
    cells = cell_of(*views.T)
    return contrast(predictions, shown, np.ones(len(views)), 0, cells, 1, cells)


def test_photos_err_on_their_own_and_renders_of_the_same_views_alike() -> None:
    def photographed(name: str) -> AspectGraph:
        shown = painted(NODES, 1)
        return graph(name, NODES, EDGES, shown, Trials(NODES, noisy(shown, 0.05, 3), np.ones(len(NODES), bool)))

    rendered = [model(name, 1, noise=0.05, disturbed=0.05) for name in "ab"]
    assert Predictions(rendered).layout.tolist() == [0, 0]
    assert Predictions([photographed(name) for name in "ab"]).layout.tolist() == [0, 1]


def test_copies_with_the_same_views_are_told_apart_by_nothing() -> None:
    copies = Predictions([model("a", 1, noise=0.05, disturbed=0.05), model("b", 1, noise=0.05, disturbed=0.05)])
    assert told(copies, towards(1, 10), 1) == (0.0, 0.0)


def test_different_objects_are_told_apart_whichever_comes_first() -> None:
    pair = Predictions([elsewhere("a", 1), model("b", 2, noise=0.05, disturbed=0.05)])
    for_first, error2 = told(pair, towards(1, 10), 1)
    for_second, _ = told(pair, towards(1, 10), 2)
    assert for_first > 3.0 * np.sqrt(error2) > 0.0
    assert for_second < -3.0 * np.sqrt(error2)


def test_twins_are_told_apart_where_they_differ_and_elsewhere_by_less_than_the_error() -> None:
    pair = Predictions([elsewhere("a", 1), model("b", 1, TWIN, noise=0.05, disturbed=0.05)])
    telling, error2 = told(pair, towards(1, 12), 1)
    assert moderated(np.array([telling]), np.array([error2]))[0] > 3.0
    same, error2 = told(pair, towards(-1, 12), 1)
    assert abs(moderated(np.array([same]), np.array([error2]))[0]) < 3.0


@pytest.mark.parametrize("evidence", [-8.0, -1.0, 0.0, 2.0, 10.0])
@pytest.mark.parametrize("error", [0.0, 1.0, 4.0, 10.0])
def test_moderated_odds_are_those_of_the_mean_probability(evidence: float, error: float) -> None:
    errors = np.random.default_rng(2).normal(size=200_000) * error
    mean = expit(evidence + errors).mean()
    assert expit(moderated(np.array([evidence]), np.array([error**2])))[0] == pytest.approx(mean, abs=0.03)


@pytest.mark.parametrize("seed", range(6))
def test_twins_with_views_in_other_places_are_not_named_before_the_side_was_seen_where_they_differ(seed: int) -> None:
    machine = interpreter(elsewhere("a", 1), model("b", 1, TWIN, noise=0.05, disturbed=0.05), options=CLOSED)
    state = machine.start()
    twin = TWIN * (seed % 2)
    turned = held(seed)
    for percept in seen(towards(-1, 14) @ turned.T, turned, 1, twin, noise=0.05, seed=seed):
        state, belief = machine.update(state, percept)
        assert belief.leader == -1
    for percept in seen(towards(1, 14) @ turned.T, turned, 1, twin, noise=0.05, seed=seed):
        state, belief = machine.update(state, percept)
    assert belief.leader == seed % 2


def test_what_was_known_before_the_pose_was_lost_counts_besides_the_looks() -> None:
    machine = interpreter(elsewhere("a", 1), model("b", 1, TWIN, noise=0.05, disturbed=0.05), options=CLOSED)
    state = machine.start()
    *percepts, last = seen(towards(-1, 12) @ held(2).T, held(2), 1, noise=0.05)
    for percept in percepts:
        state, _ = machine.update(state, percept)
    found = []
    for known in (0.1, 0.5, 0.9):
        _, belief = machine.update(replace(state, prior=np.array([known, 1.0 - known, 0.0])), last)
        found.append(belief.estimate.candidates[0].probability or 0.0)
    assert found[0] + 0.05 < found[1] < found[2] - 0.05


def test_different_objects_with_views_in_other_places_are_named_after_some_looks() -> None:
    machine = interpreter(elsewhere("a", 1), model("b", 2, noise=0.05, disturbed=0.05), options=CLOSED)
    state = machine.start()
    for percept in seen(looks(1, 10, step_deg=20.0), held(3), 1, noise=0.05):
        state, belief = machine.update(state, percept)
    assert belief.leader == 0


def test_who_is_far_ahead_stays_so_however_many_looks_follow() -> None:
    machine = interpreter(elsewhere("a", 1), model("b", 2, noise=0.05, disturbed=0.05), options=CLOSED)
    state, found = machine.start(), []
    for percept in seen(looks(1, 90, step_deg=20.0), held(3), 1, noise=0.05):
        state, belief = machine.update(state, percept)
        found.append(belief.estimate.candidates[0].probability or 0.0)
    assert max(found[:30]) > 0.99
    assert min(found[60:]) > max(found[:30]) - 1e-6


def test_where_one_of_them_has_no_views_a_look_tells_them_apart_by_nothing() -> None:
    everywhere, ring = elsewhere("a", 1), ring_model("b", 2)
    pair = Predictions([everywhere, ring])
    below, beside = np.array([[0.0, 0.1, -1.0]]), np.array([[0.0, 1.0, 0.05]])
    for view, known in ((below, False), (beside, True)):
        cells = cell_of(*unit(view).T)
        assert pair.known(1, cells).tolist() == [known]
        evidence, error2 = told(pair, unit(view), 1)
        assert (evidence > 0.0 and error2 > 0.0) if known else (evidence, error2) == (0.0, 0.0)
        assert (
            pair.log_at(np.zeros((1, pair.dimensions), np.float32), 1, cells[None])[0, 0] == pair.log_of_others
        ) is not known
