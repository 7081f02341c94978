"""The grids the pose filter works on: rotations, cells of the view sphere, and what models show in them."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from painted import model, painted, ring_model, unit

from viewsep.geometry import angle_between, rotation_angle
from viewsep.interpretation.metric import embedded
from viewsep.interpretation.rotation_grid import rotation_grid
from viewsep.interpretation.view_cells import CELLS, Interpolation, cell_directions, cell_of


def test_rotations_are_rotations_spread_evenly() -> None:
    grid = rotation_grid(5000)
    np.testing.assert_allclose(grid @ grid.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (5000, 3, 3)), atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(grid), 1.0)
    rng = np.random.default_rng(0)
    for _ in range(20):
        anywhere = grid[rng.integers(5000)] @ grid[rng.integers(5000)]
        nearest = min(float(rotation_angle(anywhere, near)) for near in grid[:5000])
        assert np.degrees(nearest) < 20.0


@given(st.tuples(*[st.floats(-1, 1)] * 3).filter(lambda v: np.linalg.norm(v) > 0.01))
def test_every_direction_is_in_the_cell_around_it(direction: tuple[float, float, float]) -> None:
    at = unit(np.array(direction))
    cell = int(cell_of(*at[:, None])[0])
    assert np.degrees(angle_between(cell_directions()[cell], at)) < 3.2


def test_the_middle_of_a_cell_is_in_it() -> None:
    assert (cell_of(*cell_directions().T) == np.arange(CELLS)).all()


def test_between_its_views_a_model_predicts_a_mixture_of_them() -> None:
    whole = model("a", 1)
    part = Interpolation.of(whole)
    assert part.covered.all()
    np.testing.assert_allclose(part.weight.sum(axis=1), 1.0, atol=1e-5)
    true = embedded(painted(cell_directions(), 1))
    views = embedded(whole.features)
    mixed = np.einsum("cj,cje->ce", part.weight, views[part.node])
    nearest = views[np.argmax(cell_directions() @ whole.directions.T, axis=1)]
    error = np.linalg.norm(mixed - true, axis=1)
    assert error.mean() < 0.35 * np.linalg.norm(nearest - true, axis=1).mean()


def test_a_ring_of_views_says_nothing_about_the_poles() -> None:
    part = Interpolation.of(ring_model("a", 1))
    height = np.abs(cell_directions()[:, 2])
    assert part.covered[height < 0.1].all()
    assert not part.covered[height > 0.4].any()
    assert (part.weight[height < 0.1][:, :2].min(axis=1) > 0.05).mean() > 0.5
