"""What a candidate is expected to show where it was not learned."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from painted import POLE, TWIN, graph, held, interpreter, model, painted, ring, seen, unit, unlearned

from viewsep.geometry import axis_rotation, rotation_angle, view_edges
from viewsep.interpretation import pose_filter
from viewsep.interpretation.overlay import overlays
from viewsep.interpretation.predictions import Predictions
from viewsep.interpretation.unlearned import ASKED, GAP, _wide, predictions_of
from viewsep.interpretation.view_cells import CELLS, cell_areas, cell_directions, cell_of
from viewsep.messages import Outcome, Percept
from viewsep.models.aspect_graph import AspectGraph

TURN = axis_rotation(np.array([0.6, 0.0, 0.8]), 2.0)  # of the frame that the twin was learned in
PLAIN, SAME_SIDES, OTHER = range(3)
ALL = np.arange(CELLS)


@cache
def whole(name: str, paint: int, twin: float = 0.0) -> AspectGraph:
    return model(name, paint, twin, noise=0.1, disturbed=0.3)


@cache
def library() -> tuple[AspectGraph, ...]:
    """One that is known from everywhere, its twin and a stranger, unlearned on the side where twins do not differ."""
    return (
        whole("plain", 1),
        unlearned(whole("twin", 1, TWIN), -POLE, 50.0, TURN),
        unlearned(whole("other", 2), -POLE, 50.0, np.eye(3)),
    )


@cache
def learned() -> Predictions:
    return Predictions(library())


def looks_at_the_twin(seed: int) -> list[Percept]:
    """Eight looks at the side that was not learned of it, and then eight at the one where it differs."""
    rng, rotation = np.random.default_rng(seed), held(seed)
    below, above = (unit(side * POLE + 0.25 * rng.normal(size=(8, 3))) for side in (-1.0, 1.0))
    return seen(np.concatenate([below, above]) @ rotation.T, rotation, 1, TWIN, noise=0.05, seed=seed)


def test_a_twin_in_a_frame_of_its_own_is_laid_over_the_other_one() -> None:
    (rotation, *_) = overlays(learned(), SAME_SIDES, PLAIN)
    assert float(rotation_angle(rotation, TURN.T)) < np.radians(3.0)


def test_where_it_was_not_learned_it_shows_what_its_look_alike_shows_there() -> None:
    before, after = learned(), predictions_of(library())
    unknown = ~before.known(SAME_SIDES, ALL)
    assert cell_areas()[unknown].sum() > 0.1
    assert after.known(SAME_SIDES, ALL).all()
    truth = before.prediction(PLAIN, cell_of(*(cell_directions()[unknown] @ TURN).T))
    wrong2 = ((after.prediction(SAME_SIDES, ALL[unknown]) - truth) ** 2).sum(axis=1)
    assert np.median(wrong2) < 0.2 * before.typical2


def test_where_it_was_learned_nothing_changes() -> None:
    before, after = learned(), predictions_of(library())
    for k in range(3):
        known = before.known(k, ALL)
        np.testing.assert_array_equal(before.prediction(k, ALL[known]), after.prediction(k, ALL[known]))
    assert (after.temper, after.log_of_others, after.log_error2) == (
        before.temper,
        before.log_of_others,
        before.log_error2,
    )


def test_one_that_looks_like_nobody_gets_nothing_and_the_lender_stays_as_it_is() -> None:
    before, after = learned(), predictions_of(library())
    np.testing.assert_array_equal(before.known(OTHER, ALL), after.known(OTHER, ALL))
    np.testing.assert_array_equal(before.prediction(PLAIN, ALL), after.prediction(PLAIN, ALL))


def test_looks_from_there_fit_it_as_they_fit_its_look_alike_whoever_is_asked_about() -> None:
    predictions = predictions_of(library())
    (percept, *_) = looks_at_the_twin(1)
    look = predictions.project(percept.feature)
    alone = predictions.log_likelihood(look, np.array([SAME_SIDES]), 0.5)
    both = predictions.log_likelihood(look, np.array([PLAIN, SAME_SIDES]), 0.5)
    np.testing.assert_allclose(alone[0], both[1], rtol=1e-5, atol=1e-4)
    assert both[1].max() == pytest.approx(both[0].max(), abs=0.1)
    fit = predictions.fit(predictions.nearest2(look))
    assert fit[SAME_SIDES] == pytest.approx(fit[PLAIN], rel=0.05)
    assert learned().fit(learned().nearest2(look))[SAME_SIDES] < 0.7 * fit[PLAIN]


@pytest.mark.parametrize("seed", range(3))
def test_a_twin_seen_from_its_unlearned_side_is_not_taken_for_the_other_one(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    def leaders() -> list[int]:
        machine = interpreter(*library())
        state, found = machine.start(), []
        for percept in looks_at_the_twin(seed):
            state, belief = machine.update(state, percept)
            found.append(belief.leader)
        return found

    found = leaders()
    assert PLAIN not in found
    assert found[-1] == SAME_SIDES
    monkeypatch.setattr(pose_filter, "predictions_of", Predictions)
    assert PLAIN in leaders()[:8], "the looks do not show what the borrowed views are for"


def test_what_was_not_learned_may_look_like_anything_too() -> None:
    """The twin differs where it was not learned: what its look-alike shows there is not held against it."""
    models = whole("plain", 1), unlearned(whole("twin", 1, TWIN), POLE, 50.0, TURN)
    predictions, rotation = predictions_of(models), held(3)
    (look,) = predictions.metric.project(painted(POLE[None], 1, TWIN))
    plain, twin = predictions.log_likelihood(look, np.arange(2), 0.5)[:, cell_of(*np.array([POLE, TURN @ POLE]).T)]
    assert plain[0] < predictions.log_of_others
    assert twin[1] == np.float32(predictions.log_of_others)
    at = cell_of(*(TURN @ POLE)[:, None])
    assert predictions.log_at(look[None], 1, at[None])[0, 0] == predictions.log_of_others
    rng = np.random.default_rng(1)
    sides = unit(np.concatenate([-POLE + 0.5 * rng.normal(size=(6, 3)), POLE + 0.2 * rng.normal(size=(6, 3))]))
    machine = interpreter(*models)
    state = machine.start()
    for percept in seen(sides @ rotation.T, rotation, 1, TWIN, noise=0.05):
        state, belief = machine.update(state, percept)
        assert belief.leader != 0
        assert belief.conclusion is None or belief.conclusion.outcome is not Outcome.UNKNOWN


def test_two_that_were_learned_from_opposite_sides_lend_each_other_what_they_lack() -> None:
    upper = unlearned(whole("upper", 1), -POLE, 50.0, TURN)
    lower = unlearned(whole("lower", 1), POLE, 50.0, np.eye(3))
    predictions = predictions_of((upper, lower))
    assert predictions.known(0, ALL) @ cell_areas() > 0.99
    assert predictions.known(1, ALL) @ cell_areas() > 0.99
    for view in (POLE, -POLE):
        look = predictions.project(painted(view[None], 1)[0])
        best = predictions.log_likelihood(look, np.arange(2), 0.5).max(axis=1)
        assert best[0] == pytest.approx(best[1], abs=0.2)


def test_of_two_look_alikes_the_more_alike_one_lends() -> None:
    gapped = unlearned(whole("gapped", 1), POLE, 40.0, np.eye(3))  # from where the twin differs
    predictions = predictions_of((gapped, whole("twin", 1, TWIN), whole("same", 1)))
    cell = int(cell_of(*POLE[:, None])[0])
    shown, of_twin, of_same = (predictions.prediction(k, np.array([cell]))[0] for k in range(3))
    assert np.linalg.norm(shown - of_same) < 0.2 * np.linalg.norm(shown - of_twin)


@pytest.mark.parametrize("turned_deg", [0.0, 50.0])
def test_twins_of_a_ring_lend_each_other_nothing_although_the_tilt_between_them_is_vague(turned_deg: float) -> None:
    at, aside = ring(10.0, 25.0), axis_rotation(np.array([1.0, 0.0, 0.0]), np.radians(80.0))
    turn = axis_rotation(POLE, np.radians(turned_deg))
    models = tuple(
        graph(name, at, view_edges(at), painted(seen_from @ aside, 1, twin))
        for name, seen_from, twin in (("plain", at, 0.0), ("twin", at @ turn, TWIN))
    )
    assert Predictions(models).resembling(0, ASKED).tolist() == [1]
    for k in range(2):
        np.testing.assert_array_equal(predictions_of(models).known(k, ALL), Predictions(models).known(k, ALL))


def test_of_gaps_what_is_wide_is_lent_up_to_its_edge_and_strips_are_not() -> None:
    middles = cell_directions()
    cap, strip = middles @ POLE > np.cos(np.radians(30.0)), np.abs(middles @ POLE) < np.sin(np.radians(5.0))
    np.testing.assert_array_equal(_wide(cap, np.radians(10.0)), cap)
    assert not _wide(strip, np.radians(10.0)).any()
    np.testing.assert_array_equal(_wide(cap | strip, np.radians(10.0)), cap)
    assert _wide(np.ones(CELLS, bool), 0.2).all()
    assert not _wide(np.zeros(CELLS, bool), 0.2).any()


def test_models_of_everywhere_are_what_they_were() -> None:
    models = whole("plain", 1), whole("twin", 1, TWIN)
    assert Predictions(models).known(0, ALL) @ cell_areas() > 1.0 - GAP
    after, before = predictions_of(models), Predictions(models)
    for k in range(2):
        np.testing.assert_array_equal(before.prediction(k, ALL), after.prediction(k, ALL))
        np.testing.assert_array_equal(before.known(k, ALL), after.known(k, ALL))
