"""Which views are photographed, in which order."""

from __future__ import annotations

import numpy as np
import pytest

from viewsep.capture.plan import plan_shots
from viewsep.geometry import angle_between
from viewsep.kinematics import preset
from viewsep.planning.reachable import ReachableViews
from viewsep.sim.view_set import Use


@pytest.mark.parametrize("rig", ["turntable", "pan_tilt", "wrist", "gimbal"])
@pytest.mark.parametrize("spacing_deg", [15.0, 30.0])
def test_there_is_a_view_near_every_reachable_one_and_none_too_many(rig: str, spacing_deg: float) -> None:
    reachable = ReachableViews.of(preset(rig))
    shots = plan_shots(reachable, reachable.directions[5], np.radians(spacing_deg), 0.5)
    views = np.array([shot.direction for shot in shots if shot.use is Use.VIEW])
    nearest = np.degrees(np.arccos(np.clip(reachable.directions @ views.T, -1.0, 1.0)).min(axis=1))
    assert nearest.max() <= 0.6 * spacing_deg
    apart = np.degrees(np.arccos(np.clip(views @ views.T, -1.0, 1.0))) + 360.0 * np.eye(len(views))
    assert apart.min() >= 0.59 * spacing_deg
    assert len(shots) - len(views) == round(0.5 * len(views))


def test_the_next_one_is_near_and_half_of_the_trials_come_at_the_end() -> None:
    reachable = ReachableViews.of(preset("turntable"))
    shots = plan_shots(reachable, reachable.directions[5], np.radians(20.0), 0.5)
    assert [shot.number for shot in shots] == list(range(len(shots)))
    trials = [shot.number for shot in shots if shot.use is Use.TRIAL]
    late = len(trials) // 2
    assert trials[-late:] == list(range(len(shots) - late, len(shots)))
    way = np.array([shot.direction for shot in shots[: len(shots) - late]])
    steps = np.degrees(angle_between(way[1:], way[:-1]))
    assert np.median(steps) <= 20.0
    assert steps.sum() < 2.0 * 360.0


def test_the_same_rig_gives_the_same_plan() -> None:
    reachable = ReachableViews.of(preset("pan_tilt"))
    once, again = (plan_shots(reachable, reachable.directions[0], 0.4, 0.3) for _ in range(2))
    np.testing.assert_array_equal([shot.direction for shot in once], [shot.direction for shot in again])
    assert [shot.use for shot in once] == [shot.use for shot in again]


def test_without_trials_there_are_views_only() -> None:
    reachable = ReachableViews.of(preset("turntable"))
    assert all(shot.use is Use.VIEW for shot in plan_shots(reachable, reachable.directions[0], 0.4, 0.0))
