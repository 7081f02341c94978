"""The planner that asks for no motion: where it lets the rating decide, and a task on a rig that nobody turns."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from viewsep.assembly import make_engine
from viewsep.config import Config, parse_config
from viewsep.geometry import spherical_direction
from viewsep.interfaces import Interpretation
from viewsep.learning import learn_object
from viewsep.messages import (
    Estimate,
    FloatArray,
    Outcome,
    Phase,
)
from viewsep.models.aspect_graph import AspectGraph
from viewsep.planning.reachable import ReachableViews
from viewsep.planning.stay import StayOptions, StayPlanner
from viewsep.task import Task, run_task


def view(azimuth_deg: float) -> FloatArray:
    """A view direction on the equator."""
    return spherical_direction(np.radians(azimuth_deg), 0.0)


def belief(*, converged: bool, fresh: bool = False) -> Interpretation:
    estimate = Estimate(0, 0, Phase.EXPLORING, (), 0, 0.0, None)
    return Interpretation(estimate, np.eye(3)[None], converged, np.ones(1, bool), -1, fresh)


@pytest.fixture(scope="module")
def turntable() -> ReachableViews:
    return ReachableViews(np.array([view(azimuth) for azimuth in range(0, 360, 10)]), lambda views: views[..., 2] == 0)


def test_it_asks_for_the_present_view_only_and_judges_there_once_poses_have_converged(
    turntable: ReachableViews,
) -> None:
    planner = StayPlanner([], turntable)
    state, first = planner.start(0, view(0))
    assert first.view_direction is None
    for azimuth, known in ((0, None), (0, belief(converged=False)), (50, belief(converged=False))):
        state, plan = planner.next_view(state, view(azimuth), known)
        assert (plan.view_direction, plan.purpose, plan.arrives) == (None, Phase.EXPLORING, False)
    for azimuth in (60, 70, 20):
        state, plan = planner.next_view(state, view(azimuth), belief(converged=True))
        assert plan.arrives
        assert plan.target is not None
        assert plan.target is plan.view_direction
        assert np.array_equal(plan.target, view(azimuth))


def test_poses_have_not_converged_before_the_object_was_turned(turntable: ReachableViews) -> None:
    planner = StayPlanner([], turntable, StayOptions(turned_deg=45.0))
    state, _ = planner.start(0, view(0))
    for azimuth, judges in ((0, False), (44, False), (46, True), (0, True)):
        state, plan = planner.next_view(state, view(azimuth), belief(converged=True))
        assert plan.arrives is judges
    state, plan = planner.next_view(state, view(90), belief(converged=True, fresh=True))  # all over again
    assert not plan.arrives
    for azimuth, judges in ((120, False), (136, True)):
        state, plan = planner.next_view(state, view(azimuth), belief(converged=True))
        assert plan.arrives is judges


def test_what_was_read_beyond_a_limit_becomes_a_view_the_rig_can_show(turntable: ReachableViews) -> None:
    planner = StayPlanner([], turntable, StayOptions(turned_deg=0.0))
    above = spherical_direction(np.radians(30), np.radians(0.1))
    _, plan = planner.next_view(planner.start(0, view(0))[0], above, belief(converged=True))
    assert plan.view_direction is not None
    assert np.array_equal(plan.view_direction, view(30))


SMALL: dict[str, Any] = {"camera": {"size_px": 64}, "sim": {"light": 0.3, "noise": 0.02}}
SOURCES = {"tea": "generated:5", "decaf": "generated:5:twin=face"}


def learned(**table: Any) -> tuple[Config, list[AspectGraph]]:
    config = parse_config({**SMALL, **table}, "test")
    return config, [learn_object(source, name, 48, config) for name, source in SOURCES.items()]


@pytest.mark.needs_pybullet
def test_a_rig_that_nobody_turns_stays_and_ends_undecided() -> None:
    config, models = learned(planner={"name": "off"}, task={"max_looks": 25})
    engine = make_engine(config, models)
    assert engine.restore(engine.save(engine.start())).phase is Phase.IDLE
    for seed in (1, 7):  # the rating alone would name one of them
        result = run_task(Task(SOURCES["tea"], "tea", seed), config, models).result
        assert (result.outcome, result.looks) == (Outcome.UNDECIDED, 25)
        assert result.travel_rad == pytest.approx(0.0, abs=1e-6)
