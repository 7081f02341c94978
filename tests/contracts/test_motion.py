"""The motion contract on every backend: add one factory per implementation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from motion_contract import MotionCase, MotionContract

from viewsep.interfaces import JointLimits
from viewsep.kinematics import PRESETS, RigGeometry, preset, rig_geometry
from viewsep.messages import Array
from viewsep.sim.clock import SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.motion import ENCODER_STEP_RAD, SimMotion
from viewsep.sim.plate import PhotoPlate
from viewsep.sim.world import SimWorld


def simulated(name: str, disturbances: Disturbances | None = None) -> Callable[[], MotionCase]:
    def make() -> MotionCase:
        clock = SimClock()
        world = SimWorld(preset(name), clock, 0, disturbances or Disturbances())
        return MotionCase(SimMotion(world), clock, ENCODER_STEP_RAD)

    return make


def plate(geometry: RigGeometry, rests_deg: Array) -> Callable[[], MotionCase]:
    """A plate over photos rests only where it shows one: its set-points are rounded to the closest of these."""

    def make() -> MotionCase:
        clock = SimClock()
        world = PhotoPlate(geometry, clock, Disturbances(), np.radians(rests_deg), 1.0)
        furthest = np.radians(max(np.diff(np.unique(joint)).max() for joint in rests_deg.T))
        return MotionCase(SimMotion(world), clock, furthest + ENCODER_STEP_RAD)

    return make


TILT_AND_PAN = rig_geometry(
    "photos",
    [[0, 1, 0], [0, 0, 1]],
    [JointLimits("tilt", 0.0, np.radians(60.0), 0.35), JointLimits("pan", -np.inf, np.inf, 0.35)],
    0.0,
)
RING = np.arange(0.0, 360.0, 5.0)[:, None]
GRID = np.array([(tilt, pan) for tilt in (0.0, 20.0, 40.0, 60.0) for pan in np.arange(0.0, 360.0, 7.5)])
IMPLEMENTATIONS: dict[str, Callable[[], MotionCase]] = {
    **{f"simulated {name}": simulated(name) for name in PRESETS},
    "simulated gimbal with play": simulated("gimbal", Disturbances(backlash_deg=2.0)),
    "photos on a ring": plate(preset("turntable"), RING),
    "photos on a ring with holes": plate(preset("turntable"), RING[np.arange(72) % 5 > 0]),
    "photos on four rings": plate(TILT_AND_PAN, GRID),
}


def marked(name: str) -> pytest.ParameterSet:
    marks = [pytest.mark.needs_pybullet] if name.startswith("simulated") else []
    return pytest.param(IMPLEMENTATIONS[name], marks=marks, id=name)


@pytest.fixture(params=[marked(name) for name in IMPLEMENTATIONS])
def case(request: pytest.FixtureRequest) -> MotionCase:
    made: MotionCase = request.param()
    return made


class TestMotion(MotionContract):
    pass
