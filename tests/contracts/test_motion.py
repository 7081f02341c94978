"""The motion contract on every backend: add one factory per implementation."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from motion_contract import MotionCase, MotionContract

from viewsep.kinematics import PRESETS, preset
from viewsep.sim.clock import SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.motion import ENCODER_STEP_RAD, SimMotion
from viewsep.sim.world import SimWorld


def simulated(name: str, disturbances: Disturbances | None = None) -> Callable[[], MotionCase]:
    def make() -> MotionCase:
        clock = SimClock()
        world = SimWorld(preset(name), clock, 0, disturbances or Disturbances())
        return MotionCase(SimMotion(world), clock, ENCODER_STEP_RAD)

    return make


IMPLEMENTATIONS: dict[str, Callable[[], MotionCase]] = {
    **{f"simulated {name}": simulated(name) for name in PRESETS},
    "simulated gimbal with play": simulated("gimbal", Disturbances(backlash_deg=2.0)),
}


@pytest.fixture(params=IMPLEMENTATIONS.values(), ids=list(IMPLEMENTATIONS))
def case(request: pytest.FixtureRequest) -> MotionCase:
    made: MotionCase = request.param()
    return made


@pytest.mark.needs_pybullet
class TestMotion(MotionContract):
    pass
