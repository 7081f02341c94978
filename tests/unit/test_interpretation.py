"""Path hypotheses follow the controlled path, find the pose, rate twins alike, and follow section IV step by step."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import get_args

import numpy as np
import pytest

from viewsep.descriptors.cch import ColourCooccurrence
from viewsep.errors import BadInput
from viewsep.geometry import (
    angle_between,
    axis_rotation,
    azimuth_elevation,
    delaunay_edges,
    equidistant_sphere,
    move_along,
    perpendicular,
    random_rotation,
    rotation_angle,
    spherical_direction,
    unit,
)
from viewsep.interfaces import Interpretation
from viewsep.interpretation.candidates import Candidates
from viewsep.interpretation.convergence import running_variance
from viewsep.interpretation.hypotheses import (
    children_of,
    distinct_paths,
    grow,
    most_similar_child,
    path_elements,
    without_loop,
)
from viewsep.interpretation.interpreter import Alignment, PathInterpreter, PathOptions, PathState, Variant
from viewsep.interpretation.rating import (
    accumulated_similarity,
    best_per_candidate,
    mean_position,
    path_course,
    queue_positions,
)
from viewsep.interpretation.transformation import align_start_and_end, align_whole_path
from viewsep.messages import FloatArray, Percept
from viewsep.models.aspect_graph import AspectGraph, Provenance

Z = np.array([0.0, 0.0, 1.0])
X = np.array([1.0, 0.0, 0.0])
NODES = equidistant_sphere(100)
EDGES = delaunay_edges(NODES)
SPACING_RAD = float(angle_between(NODES[EDGES[:, 0]], NODES[EDGES[:, 1]]).mean())
EVERY_VARIANT = pytest.mark.parametrize("variant", get_args(Variant))
EVERY_ALIGNMENT = pytest.mark.parametrize("alignment", get_args(Alignment))


def directions(rng: np.random.Generator, count: int) -> FloatArray:
    return unit(rng.normal(size=(count, 3)))


def features_at(views: FloatArray, look: int) -> FloatArray:
    """Features (N, 60) of views (N, 3) that change smoothly and nowhere repeat: random spots in each, by `look`."""
    spots = directions(np.random.default_rng(look), 60)
    bumps = np.exp(-((angle_between(views[:, None], spots[None]) / 0.4) ** 2))
    normalised: FloatArray = bumps / bumps.sum(axis=1, keepdims=True)
    return normalised


def model(name: str, look: int) -> AspectGraph:
    return AspectGraph(
        name=name,
        directions=NODES,
        edges=EDGES,
        features=features_at(NODES, look).astype(np.float32),
        thumbnails=np.zeros((len(NODES), 2, 2, 3), np.uint8),
        descriptor="spots",
        descriptor_parameters={},
        provenance=Provenance("", "", ""),
    )


def walk(steps: int, bend_rad: float = 0.15, step_rad: float = 0.16) -> FloatArray:
    """Views (steps, 3) in the object frame along a bent way."""
    view = spherical_direction(0.4, 0.2)
    heading = perpendicular(view)
    views = [view]
    for _ in range(steps - 1):
        after = move_along(view, heading, step_rad)
        heading = axis_rotation(after, bend_rad) @ unit(np.cross(np.cross(view, heading), after))
        view = after
        views.append(view)
    return np.array(views)


def percepts(views: FloatArray, rotation: FloatArray, look: int) -> list[Percept]:
    """What is perceived of an object that was grasped with `rotation` and is seen from `views` (N, 3) of its frame."""
    features = features_at(views, look).astype(np.float32)
    return [
        Percept(1000 * i, i, "spots", feature, rotation @ view)
        for i, (view, feature) in enumerate(zip(views, features, strict=True))
    ]


def interpreter(models: Sequence[AspectGraph], options: PathOptions | None = None) -> PathInterpreter:
    return PathInterpreter(models, ColourCooccurrence(), options)


def follow(method: PathInterpreter, seen: Sequence[Percept]) -> tuple[list[PathState], list[Interpretation]]:
    state, states, beliefs = method.start(), [], []
    for percept in seen:
        state, belief = method.update(state, percept)
        states.append(state)
        beliefs.append(belief)
    return states, beliefs


# ---- transformation (Fig. 4) ----


def step_by_step(start: FloatArray, end: FloatArray, c_start: FloatArray, c_end: FloatArray) -> FloatArray:
    """The paper's three rotations, one after the other."""
    alpha = azimuth_elevation(c_start)[0] - azimuth_elevation(start)[0]
    about_z = axis_rotation(Z, alpha)
    turned = about_z @ start
    about_horizon = axis_rotation(unit(np.cross(turned, c_start)), float(angle_between(turned, c_start)))
    end_then = about_horizon @ about_z @ end
    in_path, in_arc = np.cross(c_start, end_then), np.cross(c_start, c_end)
    psi = np.arctan2(np.cross(in_path, in_arc) @ c_start, in_path @ in_arc)
    return axis_rotation(c_start, float(psi)) @ about_horizon @ about_z


@pytest.mark.parametrize("seed", range(5))
def test_the_transformation_is_the_papers_three_rotations(seed: int) -> None:
    rng = np.random.default_rng(seed)
    starts, ends = directions(rng, 40), directions(rng, 40)
    c_start, c_end = directions(rng, 2)
    expected = [step_by_step(s, e, c_start, c_end) for s, e in zip(starts, ends, strict=True)]
    np.testing.assert_allclose(align_start_and_end(starts, ends, c_start, c_end), expected, atol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_the_transformation_carries_start_onto_start_and_end_onto_the_arc(seed: int) -> None:
    rng = np.random.default_rng(seed)
    starts, ends = directions(rng, 40), directions(rng, 40)
    c_start, c_end = directions(rng, 2)
    rotations = align_start_and_end(starts, ends, c_start, c_end)
    np.testing.assert_allclose(rotations @ rotations.swapaxes(1, 2), np.broadcast_to(np.eye(3), (40, 3, 3)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)
    np.testing.assert_allclose(np.einsum("pij,pj->pi", rotations, starts), np.broadcast_to(c_start, (40, 3)), atol=1e-9)
    moved = np.einsum("pij,pj->pi", rotations, ends)
    normal = np.cross(c_start, c_end)
    np.testing.assert_allclose(moved @ normal, 0.0, atol=1e-9)  # in the arc's plane,
    assert (moved @ np.cross(normal, c_start) > 0).all()  # and on its side of the start


@pytest.mark.parametrize("c_end", [X, -X], ids=["stands still", "half a turn"])
@pytest.mark.parametrize("end", [Z, -Z, X], ids=["one node", "opposite", "with tangent"])
def test_paths_without_an_arc_still_get_a_rotation_that_meets_the_start(c_end: FloatArray, end: FloatArray) -> None:
    (rotation,) = align_start_and_end(Z[None], end[None], X, c_end)
    np.testing.assert_allclose(rotation @ Z, X, atol=1e-9)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_without_an_arc_alpha_and_beta_remain() -> None:
    start, c_start = spherical_direction(0.3, -0.4), spherical_direction(2.0, 0.9)
    (rotation,) = align_start_and_end(start[None], start[None], c_start, c_start)
    axis = np.array([np.sin(2.0), -np.cos(2.0), 0.0])
    np.testing.assert_allclose(rotation, axis_rotation(axis, 1.3) @ axis_rotation(Z, 1.7), atol=1e-9)


def correlation(c: FloatArray, u: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("hi,hj->ij", c, u))


@pytest.mark.parametrize("count", [2, 3, 30])
def test_the_whole_path_fit_recovers_a_known_rotation(count: int) -> None:
    rng = np.random.default_rng(count)
    truth = [random_rotation(rng) for _ in range(20)]
    views = [directions(rng, count) for _ in truth]
    b = np.stack([correlation(u @ r.T, u) for r, u in zip(truth, views, strict=True)])
    np.testing.assert_allclose(align_whole_path(b, np.zeros((20, 3, 3))), truth, atol=1e-6)


def test_no_random_rotation_fits_the_whole_path_better() -> None:
    rng = np.random.default_rng(0)
    u, c = directions(rng, 12), directions(rng, 12)
    b = correlation(c, u)
    (fit,) = align_whole_path(b[None], np.eye(3)[None])
    assert np.linalg.det(fit) == pytest.approx(1.0)
    best = np.trace(fit.T @ b)
    near = [fit @ axis_rotation(axis, 0.02) for axis in directions(rng, 20)]
    assert all(np.trace(other.T @ b) < best for other in [*near, *(random_rotation(rng) for _ in range(300))])


def test_a_path_of_one_node_keeps_the_rotation_of_its_ends() -> None:
    fallback = axis_rotation(Z, 0.3)
    (fit,) = align_whole_path(5.0 * np.outer(X, Z)[None], fallback[None])
    np.testing.assert_array_equal(fit, fallback)


# ---- growing paths (section IV.A, C) ----


def test_candidates_keep_their_own_nodes_and_neighbours() -> None:
    both = Candidates.of([model("a", 1), model("b", 2)])
    assert both.spacing_rad == pytest.approx(SPACING_RAD)
    parent, node = children_of(np.arange(200)[:, None], both)
    assert (both.owner[node] == both.owner[parent]).all()
    pairs = {(int(a), int(b)) for a, b in zip(parent, node, strict=True)}
    edges = {(int(a), int(b)) for a, b in np.concatenate([EDGES, EDGES + 100])}
    assert pairs == edges | {(b, a) for a, b in edges} | {(n, n) for n in range(200)}


def test_candidates_of_different_descriptors_do_not_go_together() -> None:
    other = dataclasses.replace(model("b", 2), descriptor_parameters={"distance_px": 5})
    with pytest.raises(BadInput, match="'a' and 'b'"):
        Candidates.of([model("a", 1), other])
    with pytest.raises(BadInput, match="no candidates"):
        Candidates.of([])


def test_growing_appends_the_node_and_keeps_every_hit() -> None:
    hits = np.array([[0, 0, 1], [4, 5, 6]], np.int32)
    grown = grow(hits, np.array([0, 0, 1]), np.array([1, 0, 7]), loop_free=False)
    np.testing.assert_array_equal(grown, [[0, 0, 1, 1], [0, 0, 1, 0], [4, 5, 6, 7]])


def test_hits_of_a_loop_go_to_the_node_returned_to() -> None:
    hits = np.array([[0, 0, 1, 2, 3]], np.int32)
    grown = grow(hits, np.array([0, 0, 0, 0]), np.array([3, 1, 0, 4]), loop_free=True)
    np.testing.assert_array_equal(
        grown, [[0, 0, 1, 2, 3, 3], [0, 0, 1, 1, 1, 1], [0, 0, 0, 0, 0, 0], [0, 0, 1, 2, 3, 4]]
    )


def test_random_walks_never_return_to_a_node_they_left() -> None:
    rng = np.random.default_rng(3)
    candidates = Candidates.of([model("a", 1)])
    hits = rng.integers(0, 100, (60, 1)).astype(np.int32)
    for length in range(2, 40):
        parent, node = children_of(hits, candidates)
        chosen = rng.choice(len(parent), 60)
        hits = grow(hits, parent[chosen], node[chosen], loop_free=True)
        assert hits.shape == (60, length)
        runs = path_elements(hits).sum(axis=1)
        assert all(len(np.unique(path)) == run for path, run in zip(hits, runs, strict=True))


def on_equator(*degrees: float) -> FloatArray:
    return np.array([spherical_direction(np.radians(d), 0.0) for d in degrees])


def test_the_controlled_path_loses_its_loop_and_keeps_its_hits() -> None:
    out_and_back = on_equator(0, 15, 30, 45, 60, 45, 30, 16)
    cut = without_loop(out_and_back, np.radians(22.0))
    np.testing.assert_array_equal(cut, [*out_and_back[:1], *[out_and_back[-1]] * 7])


@pytest.mark.parametrize("path", [on_equator(0), on_equator(0, 0, 0), on_equator(0, 20, 0), on_equator(0, 20, 40, 60)])
def test_a_controlled_path_without_a_loop_stays_as_it_is(path: FloatArray) -> None:
    np.testing.assert_array_equal(without_loop(path, np.radians(22.0)), path)


def test_of_equal_paths_the_one_with_the_best_timing_remains() -> None:
    hits = np.array([[0, 0, 1], [0, 1, 1], [0, 1, 2], [1, 0, 0], [0, 0, 0]])
    kept = distinct_paths(hits, np.array([0.3, 0.1, 0.5, 0.2, 0.9]))
    np.testing.assert_array_equal(kept, [1, 2, 3, 4])


def test_distinct_paths_are_the_distinct_sequences_of_nodes() -> None:
    rng = np.random.default_rng(5)
    hits = rng.integers(0, 3, (400, 6))
    sequences = [tuple(path[begins]) for path, begins in zip(hits, path_elements(hits), strict=True)]
    kept = distinct_paths(hits, rng.random(400))
    assert len(kept) == len(set(sequences)) == len({sequences[i] for i in kept})


def test_every_parent_keeps_its_most_similar_child() -> None:
    parent, node = np.array([0, 1, 0, 1, 2]), np.array([3, 3, 4, 5, 0])
    similarity = np.array([0.1, np.nan, np.nan, 0.5, 0.6, 0.2])
    chosen = most_similar_child(parent, node, similarity)
    assert dict(zip(parent[chosen].tolist(), node[chosen].tolist(), strict=True)) == {0: 4, 1: 3, 2: 0}


# ---- rating (section IV.B-D) ----


def test_equal_values_share_the_first_of_their_places() -> None:
    np.testing.assert_array_equal(queue_positions(np.array([0.5, 0.1, 0.5, 0.9, 0.5])), [2, 1, 2, 5, 2])


def test_the_rating_is_the_mean_place_over_the_queues() -> None:
    rating = mean_position([np.array([0.1, 0.2, 0.3]), np.array([-5.0, -9.0, -5.0])])
    np.testing.assert_array_equal(rating, [1.5, 1.5, 2.5])


def test_ratings_do_not_depend_on_the_scale_of_the_measures() -> None:
    values = np.random.default_rng(0).random((2, 30))
    np.testing.assert_array_equal(mean_position([*values]), mean_position([1e6 * values[0], np.exp(values[1])]))


def test_every_candidate_keeps_its_own_best() -> None:
    rating = np.array([1.0, 2.0, 3.0, 9.0, 8.0, 8.0])
    tie = np.array([0.0, 0.0, 0.0, 0.0, 2.0, 1.0])
    owner = np.array([0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(best_per_candidate(rating, tie, owner, 2), [0, 1, 5, 4])


def test_w1_is_zero_for_the_path_itself_in_its_true_rotation() -> None:
    rng = np.random.default_rng(0)
    hits = rng.integers(0, 100, (5, 9))
    truth = random_rotation(rng)
    for path in hits:
        (w1,) = path_course(path[None], truth[None], NODES, NODES[path] @ truth.T)
        assert w1 == pytest.approx(0.0, abs=1e-7)


def test_w1_is_the_mean_angle_hit_by_hit() -> None:
    controlled = on_equator(0, 20, 50)
    nodes = on_equator(0, 30)
    w1 = path_course(np.array([[0, 1, 1], [0, 0, 0]]), np.broadcast_to(np.eye(3), (2, 3, 3)), nodes, controlled)
    np.testing.assert_allclose(np.degrees(w1), [(0 + 10 + 20) / 3, (0 + 20 + 50) / 3], atol=1e-5)


def test_w2_counts_path_elements_and_not_hits() -> None:
    best = np.array([0.2, 0.8, 0.5])
    w2 = accumulated_similarity(np.array([[0, 1, 1, 1, 1], [0, 0, 1, 2, 2]]), best)
    np.testing.assert_allclose(w2, [0.5, 0.5])


# ---- convergence (section IV.E) ----


def spread(angles_rad: Sequence[float]) -> FloatArray:
    return np.array([[axis_rotation(Z, angle)] for angle in angles_rad])


def test_the_running_variance_is_infinite_until_five_are_there() -> None:
    assert np.isinf(running_variance(spread([0.0] * 4))).all()
    assert running_variance(spread([0.7] * 5)) == pytest.approx(0.0, abs=1e-12)


def test_the_running_variance_is_that_of_the_angles() -> None:
    assert running_variance(spread([-0.2, -0.1, 0.0, 0.1, 0.2])) == pytest.approx(0.02)


def test_the_running_variance_does_not_depend_on_the_frames() -> None:
    rng = np.random.default_rng(1)
    means = np.array([[axis_rotation(axis, 0.2) for axis in directions(rng, 3)] for _ in range(5)])
    expected = running_variance(means)
    assert (expected > 0.001).all()
    for _ in range(5):
        np.testing.assert_allclose(running_variance(random_rotation(rng) @ means @ random_rotation(rng)), expected)


# ---- the interpreter ----


@EVERY_ALIGNMENT
@pytest.mark.parametrize("seed", range(3))
def test_the_true_pose_is_found_within_one_node_spacing(alignment: Alignment, seed: int) -> None:
    truth = random_rotation(np.random.default_rng(seed))
    options = PathOptions(alignment=alignment, converged_below_deg2=15.0)
    method = interpreter([model("other", 8), model("held", 7)], options)
    belief = follow(method, percepts(walk(22), truth, 7))[1][-1]
    assert rotation_angle(belief.rotations[1], truth) < SPACING_RAD
    other, held = belief.estimate.candidates
    assert held.rating < other.rating
    assert held.converged


@EVERY_VARIANT
@EVERY_ALIGNMENT
def test_every_variant_follows_with_sound_numbers(variant: Variant, alignment: Alignment) -> None:
    options = PathOptions(variant=variant, alignment=alignment, hypotheses=20)
    method = interpreter([model("a", 1), model("b", 2)], options)
    states, beliefs = follow(method, percepts(walk(12), random_rotation(np.random.default_rng(0)), 1))
    for state, belief in zip(states, beliefs, strict=True):
        assert state.hypotheses is not None
        assert state.hypotheses.hits.shape[1] == len(state.controlled)
        counts = np.bincount(method.owner(state.hypotheses), minlength=2)
        assert [c.hypotheses for c in belief.estimate.candidates] == counts.tolist()
        assert ((counts >= 1) & (counts <= 20)).all()
        np.testing.assert_allclose(np.linalg.det(belief.rotations), 1.0)
        assert all(c.rating >= 1.0 and 0.0 <= c.w1 <= np.pi for c in belief.estimate.candidates)
    assert [belief.fresh for belief in beliefs[:6]] == [True] * 4 + [False] * 2


@EVERY_VARIANT
def test_comparisons_count_the_distinct_nodes_that_were_compared(variant: Variant) -> None:
    models = [model("a", 1), model("b", 2)]
    method = interpreter(models, PathOptions(variant=variant, hypotheses=8, lost_above_deg=180.0))
    states, beliefs = follow(method, percepts(walk(6), np.eye(3), 1))
    near = [{int(n) for n in row if n >= 0} for row in models[0].neighbours()]
    near += [{n + 100 for n in row} for row in near]
    assert beliefs[0].estimate.comparisons == 200
    for before, belief in zip(states[:-1], beliefs[1:], strict=True):
        assert before.hypotheses is not None
        reached = set().union(*(near[last] for last in before.hypotheses.hits[:, -1]))
        assert belief.estimate.comparisons == len(reached) < 200


def snapshot(state: PathState) -> list[bytes]:
    arrays = [state.controlled, state.best_similarity, state.recent_means]
    if state.hypotheses is not None:
        h = state.hypotheses
        arrays += [h.hits, h.rotation, h.w0, h.w1, h.w2, h.rating]
    return [array.tobytes() for array in arrays]


def test_an_update_leaves_the_state_before_it_as_it_was_and_can_be_repeated() -> None:
    method = interpreter([model("a", 1), model("b", 2)])
    state = method.start()
    for percept in percepts(walk(12), np.eye(3), 1):
        before = snapshot(state)
        after, _ = method.update(state, percept)
        assert snapshot(state) == before
        assert snapshot(method.update(state, percept)[0]) == snapshot(after)
        state = after


@EVERY_VARIANT
def test_twins_that_look_the_same_everywhere_rate_the_same(variant: Variant) -> None:
    method = interpreter([model("first", 1), model("second", 1)], PathOptions(variant=variant))
    _, beliefs = follow(method, percepts(walk(15), random_rotation(np.random.default_rng(2)), 1))
    for belief in beliefs:
        first, second = belief.estimate.candidates
        assert (first.rating, first.w0, first.w2) == (second.rating, second.w0, second.w2)
        assert first.w1 == pytest.approx(second.w1)
        assert belief.leader == -1
        assert belief.plausible.all()


@EVERY_VARIANT
def test_the_order_of_the_candidates_does_not_change_their_ratings(variant: Variant) -> None:
    models = [model("a", 1), model("b", 2), model("c", 3)]
    seen = percepts(walk(12), random_rotation(np.random.default_rng(4)), 2)
    ratings = [
        [
            {c.name: (c.rating, c.w0, c.w2) for c in belief.estimate.candidates}
            for belief in follow(interpreter(order, PathOptions(variant=variant)), seen)[1]
        ]
        for order in (models, models[::-1], [models[1], models[2], models[0]])
    ]
    assert ratings[0] == ratings[1] == ratings[2]


def test_paths_that_all_lost_the_controlled_path_begin_anew() -> None:
    method = interpreter([model("a", 1), model("b", 2)])
    views = walk(8)
    jumped = np.vstack([views, -views[-1:]])  # to the other side at once: no path over neighbours gets there
    states, beliefs = follow(method, percepts(jumped, np.eye(3), 1))
    assert len(states[-2].controlled) == 8
    assert not beliefs[-2].fresh
    assert len(states[-1].controlled) == 1
    assert beliefs[-1].fresh
    assert not beliefs[-1].converged
    assert beliefs[-1].estimate.comparisons == 200


def test_the_two_best_candidates_are_always_worth_separating() -> None:
    options = PathOptions(plausible_within=1.0)  # nobody else is a rival
    method = interpreter([model("x", 8), model("held", 7), model("y", 9)], options)
    for belief in follow(method, percepts(walk(15), np.eye(3), 7))[1]:
        ratings = [candidate.rating for candidate in belief.estimate.candidates]
        assert belief.plausible[np.argsort(ratings, kind="stable")[:2]].all()
        assert belief.plausible.sum() == max(2, ratings.count(min(ratings)))


def test_a_leader_needs_to_be_five_times_better() -> None:
    method = interpreter([model("held", 7), model("other", 8)])
    for belief in follow(method, percepts(walk(15), np.eye(3), 7))[1]:
        held, other = belief.estimate.candidates
        expected = 0 if other.rating >= 5 * held.rating else 1 if held.rating >= 5 * other.rating else -1
        assert belief.leader == expected
