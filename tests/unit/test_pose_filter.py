"""The pose filter: its grids, what models predict between their views, and the posterior."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.descriptors.cch import ColourCooccurrence
from viewsep.engine.engine import Engine
from viewsep.engine.state import EngineState
from viewsep.geometry import angle_between, equidistant_sphere, rotation_angle, view_edges
from viewsep.interpretation.metric import embedded
from viewsep.interpretation.pose_filter import FilterInterpreter
from viewsep.interpretation.predictions import Predictions
from viewsep.interpretation.rotation_grid import rotation_grid
from viewsep.interpretation.view_cells import CELLS, Interpolation, cell_directions, cell_of
from viewsep.kinematics import preset
from viewsep.messages import Array, FloatArray, Percept
from viewsep.models.aspect_graph import AspectGraph, Provenance
from viewsep.planning.random_motion import RandomPlanner
from viewsep.planning.reachable import ReachableViews

DIMENSIONS = 24


def painted(directions: FloatArray, seed: int, twin: bool = False) -> Array:
    """(N, D) histograms that change smoothly over the sphere; a twin differs around one pole only."""
    rng = np.random.default_rng(seed)
    centres = rng.normal(size=(DIMENSIONS, 3))
    centres /= np.linalg.norm(centres, axis=1, keepdims=True)
    shown = np.exp(3.0 * directions @ centres.T)
    if twin:
        shown[:, :4] *= 1.0 + 20.0 * np.maximum(directions[:, 2:] - 0.5, 0.0)
    histograms: Array = (shown / shown.sum(axis=1, keepdims=True)).astype(np.float32)
    return histograms


def model(name: str, seed: int, twin: bool = False, directions: FloatArray | None = None) -> AspectGraph:
    at = equidistant_sphere(100) if directions is None else directions
    return AspectGraph(
        name=name,
        directions=at,
        edges=view_edges(at),
        features=painted(at, seed, twin),
        thumbnails=np.zeros((len(at), 4, 4, 3), np.uint8),
        descriptor="cch",
        descriptor_parameters={},
        provenance=Provenance("", "", ""),
    )


def interpreter(*models: AspectGraph) -> FilterInterpreter:
    return FilterInterpreter(models, ColourCooccurrence())


def unit(values: Array) -> FloatArray:
    return np.asarray(values / np.linalg.norm(values, axis=-1, keepdims=True))


# ---- grids ----


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


# ---- predictions ----


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
    azimuth = np.radians(np.arange(0, 360, 15))
    ring = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(len(azimuth))], axis=1)
    part = Interpolation.of(model("a", 1, directions=ring))
    height = np.abs(cell_directions()[:, 2])
    assert part.covered[height < 0.1].all()
    assert not part.covered[height > 0.4].any()
    assert (part.weight[height < 0.1][:, :2].min(axis=1) > 0.05).mean() > 0.5


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


# ---- the posterior ----


def looks(seed: int, count: int, step_deg: float = 10.0) -> FloatArray:
    """(count, 3) views of a path that wanders over the sphere."""
    rng = np.random.default_rng(seed)
    view, ahead = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
    path = [view]
    for _ in range(count - 1):
        ahead = unit(ahead + 0.3 * rng.normal(size=3))
        ahead = unit(ahead - (ahead @ view) * view)
        angle = np.radians(step_deg)
        view, ahead = np.cos(angle) * view + np.sin(angle) * ahead, np.cos(angle) * ahead - np.sin(angle) * view
        path.append(view)
    return np.array(path)


def held(seed: int) -> FloatArray:
    rotation: FloatArray = rotation_grid(7919)[seed * 101 % 7919]
    return rotation


def seen(views: FloatArray, rotation: FloatArray, paint: int, twin: bool = False) -> list[Percept]:
    features = painted(views @ rotation, paint, twin)
    return [Percept(n, n, "cch", feature, view) for n, (feature, view) in enumerate(zip(features, views, strict=True))]


@pytest.mark.parametrize("seed", range(6))
def test_pose_and_identity_are_found(seed: int) -> None:
    machine = interpreter(model("a", 1), model("b", 2))
    rotation = held(seed)
    state = machine.start()
    for percept in seen(looks(seed, 25), rotation, 1 + seed % 2):
        state, belief = machine.update(state, percept)
    assert belief.leader == seed % 2
    assert np.degrees(rotation_angle(belief.rotations[seed % 2], rotation)) < 8.0
    assert belief.converged
    total = state.posterior.probabilities().sum() + np.exp(state.posterior.none)
    assert total == pytest.approx(1.0, abs=1e-4)


def test_twins_are_told_apart_only_where_they_differ() -> None:
    machine = interpreter(model("a", 1), model("b", 1, twin=True))
    rotation = held(3)
    state = machine.start()
    views = looks(3, 200)
    hidden = views[(views @ rotation)[:, 2] < 0.3][:30]
    for percept in seen(hidden, rotation, 1):
        state, belief = machine.update(state, percept)
    assert belief.leader == -1
    poles = unit(np.array([[0.1, 0.1, 1.0], [-0.3, 0.1, 1.0], [0.3, -0.2, 1.0], [0.0, -0.4, 1.0]]))
    for percept in seen(poles @ rotation.T, rotation, 1):
        state, belief = machine.update(state, percept)
    assert belief.leader == 0


def test_an_object_that_is_no_candidate_is_none_of_them() -> None:
    machine = interpreter(model("a", 1), model("b", 2))
    state = machine.start()
    for percept in seen(looks(5, 20), held(5), 9):
        state, belief = machine.update(state, percept)
    assert np.exp(state.posterior.none) > 0.99
    assert belief.leader == -1


def test_a_look_from_the_same_place_is_no_further_evidence() -> None:
    machine = interpreter(model("a", 1), model("b", 2))
    percept, *_ = seen(looks(1, 1), held(1), 1)
    first, _ = machine.update(machine.start(), percept)
    second, _ = machine.update(first, percept)
    np.testing.assert_array_equal(first.posterior.log_p, second.posterior.log_p)


def test_a_slip_is_recovered_from() -> None:
    machine = interpreter(model("a", 1), model("b", 2))
    before, after = held(2), held(11)
    assert np.degrees(rotation_angle(before, after)) > 60.0
    state = machine.start()
    views = looks(2, 60)
    for percept in [*seen(views[:30], before, 1), *seen(views[30:], after, 1)]:
        state, belief = machine.update(state, percept)
    assert belief.leader == 0
    assert np.degrees(rotation_angle(belief.rotations[0], after)) < 10.0


def test_the_state_can_be_saved_and_gives_the_same_bits() -> None:
    models = [model("a", 1), model("b", 2)]
    machine = interpreter(*models)
    engine = Engine(machine, RandomPlanner(models, ReachableViews.of(preset("gimbal"))))
    percepts = seen(looks(4, 12), held(4), 2)
    state = machine.start()
    for percept in percepts[:6]:
        state, belief = machine.update(state, percept)
    kept = engine.restore(engine.save(EngineState(interpretation=state, belief=belief))).interpretation
    for percept in percepts[6:]:
        state, belief = machine.update(state, percept)
        kept, again = machine.update(kept, percept)
    assert engine.save(EngineState(interpretation=state, belief=belief)) == engine.save(
        EngineState(interpretation=kept, belief=again)
    )
