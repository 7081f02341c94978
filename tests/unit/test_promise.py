"""What a look is expected to tell: nothing about twins where they are alike, most where they differ."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from painted import POLE, TWIN, elsewhere, held, model, ring_model

from viewsep.geometry import angle_between, axis_rotation, fibonacci_sphere, perpendicular, unit
from viewsep.interfaces import PoseSamples
from viewsep.interpretation.independence import independent_share
from viewsep.interpretation.predictions import Predictions
from viewsep.interpretation.unlearned import predictions_of
from viewsep.messages import FloatArray
from viewsep.planning.promise import Promise, promised

VIEWS = fibonacci_sphere(200)
HELD = held(3)
INDEPENDENT_RAD = float(np.radians(10.0))


@cache
def twins(difference: float = TWIN) -> Predictions:
    return predictions_of(
        (model("a", 1, noise=0.1, disturbed=0.1), model("b", 1, difference, noise=0.1, disturbed=0.1))
    )


def samples(*parts: tuple[int, FloatArray, float], seen: FloatArray | None = None) -> PoseSamples:
    """Of candidate, rotation and weight each."""
    owners, rotations, weights = zip(*parts, strict=True)
    before = np.empty((0, 3)) if seen is None else seen
    return PoseSamples(np.array(owners), np.array(rotations), np.array(weights), before, INDEPENDENT_RAD)


def height(views: FloatArray) -> FloatArray:
    """How near to the pole in which twins differ, in the object's frame."""
    heights: FloatArray = views @ HELD @ POLE
    return heights


def promise_of_twins(first: float = 0.5, difference: float = TWIN) -> Promise:
    return promised(twins(difference), samples((0, HELD, first), (1, HELD, 1.0 - first)), VIEWS)


def test_identical_twins_promise_nothing_anywhere() -> None:
    promise = promise_of_twins(difference=0.0)
    assert promise.candidate.shape == promise.pose.shape == (200,)
    assert promise.candidate.max() < 1e-3


def test_twins_promise_most_around_the_pole_where_they_differ() -> None:
    promise = promise_of_twins()
    assert height(VIEWS)[promise.candidate.argmax()] > 0.7
    assert promise.candidate.max() > 0.5
    assert promise.candidate[height(VIEWS) < 0.0].max() < 1e-3
    assert promise.candidate[height(VIEWS) > 0.8].min() > 0.3


def test_no_look_tells_more_than_there_is_to_know() -> None:
    for first in (0.5, 0.9, 0.99):
        unknown = -first * np.log2(first) - (1.0 - first) * np.log2(1.0 - first)
        bits = promise_of_twins(first).candidate
        assert 0.5 * unknown < bits.max() <= unknown + 1e-6
        assert bits.min() >= 0.0


def test_the_more_twins_differ_the_more_is_promised() -> None:
    most = [promise_of_twins(difference=difference).candidate.max() for difference in (0.2, 2.0, TWIN)]
    assert most[0] < most[1] < most[2]


def test_the_weights_need_not_sum_to_one() -> None:
    parts = [(0, HELD, 0.3), (1, HELD, 0.1)]
    half = promised(twins(), samples(*((owner, rotation, 0.5 * weight) for owner, rotation, weight in parts)), VIEWS)
    np.testing.assert_allclose(half.candidate, promised(twins(), samples(*parts), VIEWS).candidate, atol=1e-9)


def test_a_single_candidate_promises_nothing_about_who_it_is() -> None:
    promise = promised(twins(), samples((0, HELD, 0.6), (0, held(20), 0.4)), VIEWS)
    assert promise.candidate.max() < 1e-6


def test_a_pose_that_is_known_promises_nothing_about_it() -> None:
    assert promise_of_twins().pose.max() < 2e-3
    assert promised(twins(), samples((1, HELD, 1.0)), VIEWS).pose.max() < 2e-3


def test_two_ways_to_hold_it_promise_a_bit_about_the_pose_at_most() -> None:
    promise = promised(twins(), samples((0, HELD, 0.5), (0, held(20), 0.5)), VIEWS)
    assert 0.5 < promise.pose.max() <= 1.001
    assert promise.pose.min() >= 0.0


def test_a_turn_about_the_line_of_sight_cannot_be_seen_and_promises_nothing() -> None:
    axis = unit(np.array([0.1, 0.05, 1.0]))  # well within a cell
    along, across = HELD @ axis, HELD @ perpendicular(axis)
    turned = axis_rotation(along, np.radians(20.0)) @ HELD
    bits = promised(twins(), samples((0, HELD, 0.5), (0, turned, 0.5)), np.stack([along, -along, across, -across])).pose
    assert bits[:2].max() < 0.1
    assert bits[2:].min() > 0.5


def test_the_pose_is_that_of_the_likeliest_candidate() -> None:
    parts = [(0, HELD, 0.2), (0, held(20), 0.2), (1, HELD, 0.6)]
    assert promised(twins(), samples(*parts), VIEWS).pose.max() < 2e-3
    parts = [(0, HELD, 0.3), (0, held(20), 0.3), (1, HELD, 0.4)]
    assert promised(twins(), samples(*parts), VIEWS).pose.max() > 0.5


def test_a_sample_twice_is_one_of_twice_the_weight() -> None:
    once = promised(twins(), samples((0, HELD, 0.5), (1, HELD, 0.5)), VIEWS)
    twice = promised(twins(), samples((0, HELD, 0.25), (1, HELD, 0.5), (0, HELD, 0.25)), VIEWS)
    np.testing.assert_allclose(twice.candidate, once.candidate, atol=1e-3)


@pytest.mark.parametrize("angle_deg", [0.0, 5.0, 10.0, 40.0])
def test_near_views_that_were_seen_less_is_promised(angle_deg: float) -> None:
    parts = [(0, HELD, 0.3), (0, held(20), 0.2), (1, HELD, 0.5)]
    view = HELD @ POLE
    before = axis_rotation(perpendicular(view), np.radians(angle_deg)) @ view
    assert np.degrees(angle_between(view, before)) == pytest.approx(angle_deg, abs=1e-6)
    fresh = promised(twins(), samples(*parts), view[None])
    promise = promised(twins(), samples(*parts, seen=np.stack([-view, before])), view[None])
    share = independent_share(view[None], np.stack([-view, before]), np.radians(10.0))
    assert share < 0.11 if angle_deg == 0.0 else share < 0.81 if angle_deg < 20.0 else share > 0.99
    assert fresh.candidate[0] > 0.1
    assert fresh.pose[0] > 0.1
    np.testing.assert_allclose(promise.candidate, share * fresh.candidate, rtol=1e-6)
    np.testing.assert_allclose(promise.pose, share * fresh.pose, rtol=1e-6)


def test_where_the_models_have_no_views_a_look_promises_nothing() -> None:
    rings = predictions_of((ring_model("a", 1), ring_model("b", 2)))
    bits = promised(rings, samples((0, np.eye(3), 0.5), (1, np.eye(3), 0.5)), VIEWS).candidate
    height = np.abs(VIEWS[:, 2])
    assert bits[height < 0.1].min() > 0.1
    assert (bits[height > 0.5] == 0.0).all()


def test_models_with_views_in_other_places_promise_little_where_they_differ_by_their_errors_only() -> None:
    pair = predictions_of((elsewhere("a", 1), model("b", 1, TWIN, noise=0.05, disturbed=0.05)))
    bits = promised(pair, samples((0, HELD, 0.5), (1, HELD, 0.5)), VIEWS).candidate
    assert np.median(bits[height(VIEWS) > 0.8]) > 0.5
    assert bits[height(VIEWS) < 0.0].max() < 0.1
