"""The posterior's arithmetic, its grid of rotations, and how much of a look is evidence of its own."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from painted import held, unit

from viewsep.geometry import angle_between, axis_rotation, perpendicular, rotation_angle
from viewsep.interpretation.independence import LACKING, independent_share
from viewsep.interpretation.posterior import NEIGHBOURS, Posterior, RotationGrid, neighbours_of, spacing_rad_of
from viewsep.interpretation.rotation_grid import rotation_grid
from viewsep.interpretation.view_cells import CELLS, cell_of

GRID = 2000


def posterior(seed: int = 0, spread: float = 3.0) -> Posterior:
    """Candidates 1 and 3 of five are followed."""
    rng = np.random.default_rng(seed)
    parked = rng.normal(-2.0, spread, 5)
    parked[[1, 3]] = -np.inf
    return Posterior(
        np.array([1, 3]), rng.normal(-8.0, spread, (2, GRID)).astype(np.float32), parked, float(rng.normal(-1.0))
    )


def peaked(rotation: int) -> Posterior:
    """All of one candidate's probability on one rotation."""
    log_p = np.full((1, GRID), -60.0, np.float32)
    log_p[0, rotation] = 0.0
    return Posterior(np.arange(1), log_p, np.full(1, -np.inf), -60.0)


def total(whole: Posterior) -> float:
    return float(whole.probabilities().sum() + np.exp(whole.none))


@given(st.integers(0, 1000), st.floats(0.1, 20.0))
def test_normalised_probabilities_sum_to_one_with_parked_ones_and_none(seed: int, spread: float) -> None:
    assert total(posterior(seed, spread).normalised(200.0)) == pytest.approx(1.0, abs=1e-5)


def test_all_parts_are_scaled_alike_and_the_evidence_says_by_how_much() -> None:
    raw = posterior()
    whole = raw.normalised(200.0)
    share = np.exp(raw.log_p.astype(float)).sum() + np.exp(raw.parked).sum() + np.exp(raw.none)
    assert whole.evidence == pytest.approx(np.log(share), abs=1e-5)
    np.testing.assert_allclose(whole.log_p + whole.evidence, raw.log_p, atol=1e-4)
    np.testing.assert_allclose(whole.parked + whole.evidence, raw.parked, atol=1e-6)
    assert whole.none + whole.evidence == pytest.approx(raw.none)
    again = whole.normalised(200.0)
    assert again.evidence == pytest.approx(whole.evidence, abs=1e-5)  # it counts on from what was taken off before


def test_no_rotation_falls_further_than_the_floor_below_the_best() -> None:
    whole = peaked(7).normalised(12.0)
    best = whole.log_p[0, 7]
    np.testing.assert_allclose(np.delete(whole.log_p[0], 7), best - 12.0, atol=1e-4)
    assert whole.none == pytest.approx(best - 12.0, abs=1e-4)
    assert total(whole) == pytest.approx(1.0, abs=1e-5)


def test_where_none_of_them_is_likeliest_the_floor_lies_below_that() -> None:
    even = Posterior(np.arange(1), np.full((1, GRID), -100.0, np.float32), np.full(1, -np.inf), -1.0)
    whole = even.normalised(12.0)
    np.testing.assert_allclose(whole.log_p, whole.none - 12.0, atol=1e-4)


def test_followed_candidates_have_their_rotations_sum_parked_ones_their_estimate() -> None:
    whole = posterior().normalised(200.0)
    found = whole.probabilities()
    np.testing.assert_allclose(found[[1, 3]], np.exp(whole.log_p.astype(float)).sum(axis=1), rtol=1e-5)
    np.testing.assert_allclose(found[[0, 2, 4]], np.exp(whole.parked[[0, 2, 4]]))


def test_a_look_multiplies_every_rotation_by_the_likelihood_of_its_cell() -> None:
    rng = np.random.default_rng(1)
    whole, cells = posterior(), rng.integers(0, CELLS, GRID)
    likelihood = rng.normal(size=(2, CELLS)).astype(np.float32)
    after = whole.times(likelihood, cells, np.arange(5.0), -0.5)
    np.testing.assert_allclose(after.log_p[1, 77], whole.log_p[1, 77] + likelihood[1, cells[77]], rtol=1e-6)
    np.testing.assert_array_equal(after.parked[[0, 2, 4]], whole.parked[[0, 2, 4]] + [0.0, 2.0, 4.0])
    assert np.isneginf(after.parked[[1, 3]]).all()
    assert after.none == whole.none - 0.5


# ---- diffusion ----


def test_the_neighbours_of_a_rotation_are_the_nearest_ones() -> None:
    grid, near = rotation_grid(GRID), neighbours_of(GRID).T
    assert near.shape == (GRID, NEIGHBOURS)
    for rotation in range(0, GRID, 97):
        angle = rotation_angle(grid, grid[rotation])
        angle[rotation] = np.inf
        np.testing.assert_allclose(np.sort(angle[near[rotation]]), np.sort(angle)[:NEIGHBOURS], atol=1e-9)
        assert len(set(near[rotation].tolist())) == NEIGHBOURS


def test_the_spacing_is_the_mean_angle_to_the_next_rotation() -> None:
    grid = rotation_grid(GRID)
    nearest = []
    for rotation in range(0, GRID, 10):
        angle = rotation_angle(grid, grid[rotation])
        angle[rotation] = np.inf
        nearest.append(angle.min())
    assert spacing_rad_of(GRID) == pytest.approx(float(np.mean(nearest)), rel=0.03)


def test_diffusion_spreads_to_neighbours_only() -> None:
    rotation, share = 1234, 0.25
    after = np.exp(peaked(rotation).diffused(share, GRID).log_p[0].astype(float))
    assert after[rotation] == pytest.approx(1.0 - share, abs=1e-5)
    given_to = np.flatnonzero(after > 1e-6)
    next_to = np.flatnonzero((neighbours_of(GRID) == rotation).any(axis=0))
    np.testing.assert_array_equal(given_to, np.union1d(next_to, [rotation]))
    np.testing.assert_allclose(after[next_to], share / NEIGHBOURS, rtol=1e-3)
    angle = rotation_angle(rotation_grid(GRID)[given_to], rotation_grid(GRID)[rotation])
    assert angle.max() < 3.0 * spacing_rad_of(GRID)


def test_an_even_spread_stays_as_it_is() -> None:
    even = Posterior(np.arange(2), np.full((2, GRID), -9.0, np.float32), np.full(2, -np.inf), -5.0)
    np.testing.assert_allclose(even.diffused(0.7, GRID).log_p, -9.0, atol=1e-5)


def test_nothing_to_give_away_changes_nothing() -> None:
    whole = posterior()
    assert whole.diffused(0.0, GRID) is whole


# ---- the grid of rotations ----


def test_every_rotation_sees_the_object_in_the_cell_of_its_own_view() -> None:
    grid = RotationGrid(GRID)
    view = unit(np.array([0.3, -0.8, 0.4]))
    in_object = rotation_grid(GRID).transpose(0, 2, 1) @ view
    assert (grid.cells(view) == cell_of(*in_object.T)).mean() > 0.999  # single precision at the edges


def test_the_pose_is_the_mean_around_the_best_rotation_and_its_spread() -> None:
    grid, rotation = RotationGrid(GRID), 321
    mean, spread = grid.pose(*peaked(rotation).likely(0))
    np.testing.assert_allclose(mean, rotation_grid(GRID)[rotation], atol=1e-6)
    assert spread == pytest.approx((0.5 * spacing_rad_of(GRID)) ** 2, abs=1e-5)  # it is no finer than the grid
    angle = rotation_angle(rotation_grid(GRID), held(5))
    width = np.radians(10.0)
    mean, spread = grid.pose(np.arange(GRID), (-0.5 * (angle / width) ** 2).astype(np.float32))
    assert np.degrees(rotation_angle(mean, held(5))) < 6.0  # the grid is 15 degrees apart
    assert np.sqrt(spread) == pytest.approx(np.sqrt(3.0) * width, rel=0.2)


def test_two_ways_to_hold_it_are_not_averaged_but_widen_the_spread() -> None:
    grid = RotationGrid(GRID)
    log_p = peaked(321).log_p[0].copy()
    apart = rotation_angle(rotation_grid(GRID), rotation_grid(GRID)[321])
    other = int(np.argmin(np.abs(apart - np.radians(90.0))))
    log_p[other] = -0.1
    mean, spread = grid.pose(np.arange(GRID), log_p)
    np.testing.assert_allclose(mean, rotation_grid(GRID)[321], atol=1e-6)
    share = np.exp(-0.1) / (1.0 + np.exp(-0.1))
    assert spread == pytest.approx(share * apart[other] ** 2 + (0.5 * spacing_rad_of(GRID)) ** 2, rel=0.01)


# ---- independence ----


@pytest.mark.parametrize("angle_deg", [0.0, 0.5, 5.0, 10.0, 90.0])
def test_a_look_counts_the_more_the_further_it_is_from_those_before(angle_deg: float) -> None:
    """Of two looks with errors correlated by c, the second is worth (1 - c) / (1 + c)."""
    view = unit(np.array([0.2, 0.9, -0.1]))
    there = axis_rotation(perpendicular(view), np.radians(angle_deg)) @ view
    far = -view
    found = independent_share(there[None], np.stack([view, far]), np.radians(10.0))
    assert np.degrees(angle_between(view, there)) == pytest.approx(angle_deg)
    shared = LACKING * np.exp(-angle_deg / 5.0)
    assert found == pytest.approx([(1.0 - shared) / (1.0 + shared)], abs=1e-6)


def test_however_often_a_place_is_looked_at_it_is_worth_little_more_than_one_look() -> None:
    view, shares = unit(np.array([0.2, 0.9, -0.1])), []
    for looked in range(200):
        seen = np.repeat(view[None], looked, axis=0)
        shares.append(float(independent_share(view[None], seen, 0.2)[0]))
    assert shares == sorted(shares, reverse=True)
    assert sum(shares) == pytest.approx(1.0 / LACKING, rel=0.01)


def test_a_second_lap_is_worth_a_fraction_of_the_first() -> None:
    laps = []
    seen = np.empty((0, 3))
    for offset in (0.0, 1.5, 0.75):
        azimuth = np.radians(np.arange(offset, 360.0, 3.0))
        worth = 0.0
        for view in np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))], axis=1):
            worth += float(independent_share(view[None], seen, np.radians(10.0))[0])
            seen = np.vstack([seen, view])
        laps.append(worth)
    assert 36.0 < laps[0] < 48.0  # about one in 10 degrees
    assert laps[1] < 0.1 * laps[0]
    assert laps[2] < 0.5 * laps[1]


def test_the_first_look_counts_in_full() -> None:
    np.testing.assert_array_equal(independent_share(np.eye(3), np.empty((0, 3)), 0.2), np.ones(3))
