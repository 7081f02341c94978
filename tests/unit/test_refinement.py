"""A pose finer than the grid, and how far off it may be."""

from __future__ import annotations

import numpy as np
import pytest
from painted import held, looks, model, painted

from viewsep.geometry import axis_rotation, rotation_angle
from viewsep.interpretation.predictions import Predictions
from viewsep.interpretation.refinement import REGION_ERROR_RAD, refined
from viewsep.messages import Array, FloatArray

PREDICTIONS = Predictions([model("a", 1, noise=0.05, disturbed=0.3), model("b", 2, noise=0.05, disturbed=0.3)])
TRUTH = held(5)


def shown(views: FloatArray) -> Array:
    return PREDICTIONS.metric.project(painted(views @ TRUTH, 1))


def found(views: FloatArray, off_deg: float, about: int) -> tuple[float, float]:
    """Degrees by which the refined pose is wrong, and its spread, from a pose that is off."""
    off = axis_rotation(np.eye(3)[about], np.radians(off_deg)) @ TRUTH
    rotation, variance = refined(PREDICTIONS, 0, off, shown(views), views, np.ones(len(views)))
    return float(np.degrees(rotation_angle(rotation, TRUTH))), float(np.degrees(np.sqrt(variance)))


@pytest.mark.parametrize("about", [0, 1, 2])
@pytest.mark.parametrize("off_deg", [0.0, 8.0, 16.0])
def test_a_pose_that_is_a_little_off_is_found(off_deg: float, about: int) -> None:
    wrong, spread = found(looks(1, 16), off_deg, about)
    assert wrong < 2.5
    assert wrong < spread < 6.0


def test_many_looks_at_one_region_do_not_make_a_pose_sure_but_looks_at_more_regions_do() -> None:
    view = looks(3, 1)[0]
    near = np.array([axis_rotation(np.roll(view, 1), np.radians(angle)) @ view for angle in np.linspace(0.0, 25.0, 20)])
    assert found(near, 3.0, 0)[1] >= np.degrees(REGION_ERROR_RAD)
    assert found(looks(1, 16, step_deg=25.0), 3.0, 0)[1] < np.degrees(REGION_ERROR_RAD) / 2.0


def test_repeated_looks_have_no_say_and_without_others_nothing_is_known() -> None:
    views, off = looks(1, 4), axis_rotation(np.eye(3)[0], 0.1) @ TRUTH
    rotation, variance = refined(PREDICTIONS, 0, off, shown(views), views, np.full(4, 0.1))
    np.testing.assert_array_equal(rotation, off)
    assert variance == np.inf
