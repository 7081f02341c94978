"""The contract of planners on every one of them: add one line per implementation."""

from __future__ import annotations

from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pytest

from viewsep.config import PlannerConfig
from viewsep.engine.keyframe import StateCodec
from viewsep.engine.state import EngineState
from viewsep.geometry import angle_between, delaunay_edges, equidistant_sphere, random_rotation, spherical_direction
from viewsep.interfaces import Interpretation, NextView, Planner, PoseSamples
from viewsep.interpretation.filter_state import FilterState
from viewsep.kinematics import preset
from viewsep.messages import CandidateEstimate, Estimate, FloatArray, Phase
from viewsep.models.aspect_graph import AspectGraph, Provenance
from viewsep.planning.information import InformationPlanner
from viewsep.planning.reachable import ReachableViews
from viewsep.plugins import make_planner

PLANNERS: dict[str, dict[str, Any]] = {"information": {}, "off": {}, "random": {}, "separating": {}, "sweep": {}}
"""The planners by name, each with the options it is tried with."""

STEPS = 60
NODES = equidistant_sphere(48)


@cache
def views(name: str) -> ReachableViews:
    """All views of a preset, or a ring of photos with a gap."""
    if name == "photos":
        azimuths = np.radians([*range(0, 120, 10), *range(200, 360, 10)])
        return ReachableViews.only(np.array([spherical_direction(azimuth, 0.3) for azimuth in azimuths]))
    return ReachableViews.of(preset(name))


@cache
def models() -> tuple[AspectGraph, ...]:
    """Two look-alikes that differ from one side."""
    features = np.random.default_rng(2).random((len(NODES), 8)).astype(np.float32)
    changed = features.copy()
    changed[NODES[:, 0] > 0.7] += 1.0
    return tuple(
        AspectGraph(
            name=name,
            directions=NODES,
            edges=delaunay_edges(NODES),
            features=shown / shown.sum(axis=1, keepdims=True),
            thumbnails=np.zeros((len(NODES), 1, 1, 3), np.uint8),
            descriptor="made by hand",
            descriptor_parameters={},
            provenance=Provenance("none", "none", "none"),
        )
        for name, shown in (("tea", features), ("decaf", changed))
    )


def belief(look: int) -> Interpretation | None:
    """None at first, then a posterior that converges, and at times begins anew."""
    if look == 0:
        return None
    rng = np.random.default_rng(look)
    rotations = np.array([random_rotation(np.random.default_rng(4))] * 2)
    p, converged, fresh = (0.6, 0.37, 0.03), look > 8, look % 25 == 24
    candidates = tuple(
        CandidateEstimate(model.name, 1 / p[k], 0.9, 0.1, p[k], rotations[k], 0.01, converged, 100, p[k])
        for k, model in enumerate(models())
    )
    estimate = Estimate(look, look, Phase.EXPLORING, candidates, 96, 0.0, None, p[2])
    owner = rng.integers(2, size=20)
    weight = np.array(p)[owner] / np.bincount(owner, minlength=2)[owner]
    samples = PoseSamples(owner, np.array([random_rotation(rng) for _ in range(20)]), weight)
    return Interpretation(estimate, rotations, converged, np.ones(2, bool), -1, fresh, samples=samples)


def followed(planner: Planner, reachable: ReachableViews, seed: int) -> tuple[list[NextView], list[Any], FloatArray]:
    """What is asked for from the start on, the states before it, and the start view."""
    here = reachable.directions[3]
    state, first = planner.start(seed, here)
    asked, states = [first], [state]
    for look in range(STEPS):
        here = asked[-1].view_direction if asked[-1].view_direction is not None else here
        state, wanted = planner.next_view(states[-1], here, belief(look))
        asked.append(wanted)
        states.append(state)
    return asked, states, here


@pytest.fixture(params=product(PLANNERS, ("turntable", "pan_tilt", "gimbal", "photos")), ids="-".join)
def case(request: pytest.FixtureRequest) -> tuple[Planner, ReachableViews]:
    name, rig = request.param
    return make_planner(PlannerConfig(name=name, options=PLANNERS[name]), models(), views(rig)), views(rig)


def test_only_views_the_rig_can_show_are_asked_for(case: tuple[Planner, ReachableViews]) -> None:
    planner, reachable = case
    asked, _, _ = followed(planner, reachable, 5)
    assert asked[0].purpose is Phase.STARTING
    for wanted in asked:
        if wanted.view_direction is not None:
            assert reachable.reaches(wanted.view_direction)
            assert float(np.linalg.norm(wanted.view_direction)) == pytest.approx(1.0)
        if wanted.target is not None:
            assert reachable.reaches(wanted.target)
        if wanted.arrives:
            assert wanted.target is not None
            if not isinstance(planner, InformationPlanner):  # which waits for looks on the way, too
                np.testing.assert_array_equal(wanted.view_direction, wanted.target)


def test_the_seed_decides_everything(case: tuple[Planner, ReachableViews]) -> None:
    planner, reachable = case
    once, again = (followed(planner, reachable, 5)[0] for _ in range(2))
    for one, other in zip(once, again, strict=True):
        np.testing.assert_array_equal(one.view_direction, other.view_direction)
        assert (one.purpose, one.arrives) == (other.purpose, other.arrives)


def test_states_are_not_changed_and_can_be_kept(case: tuple[Planner, ReachableViews]) -> None:
    planner, reachable = case
    asked, states, _ = followed(planner, reachable, 6)
    codec = StateCodec(FilterState, planner.state_type)
    here = reachable.directions[3]
    for look, (before, wanted) in enumerate(zip(states, asked, strict=True)):
        here = wanted.view_direction if wanted.view_direction is not None else here
        kept = codec.to_bytes(EngineState(planning=before))
        assert isinstance(before, planner.state_type)
        if look % 10 == 0 and look < STEPS:
            _, later = planner.next_view(codec.from_bytes(kept).planning, here, belief(look))
            np.testing.assert_array_equal(later.view_direction, asked[look + 1].view_direction)
        assert codec.to_bytes(EngineState(planning=before)) == kept


def test_moves_are_no_leaps(case: tuple[Planner, ReachableViews]) -> None:
    """Once the rig has started; what lies between the recorded views of a gap has to be leapt over."""
    planner, reachable = case
    asked, _, _ = followed(planner, reachable, 7)
    way = np.array([wanted.view_direction for wanted in asked if wanted.view_direction is not None])
    if len(way) > 1:
        assert np.degrees(angle_between(way[1:], way[:-1])).max() <= (91.0 if reachable.single else 25.0)
