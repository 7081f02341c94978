"""The camera contract on every camera: add one factory per implementation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from camera_contract import CameraCase, CameraContract

from viewsep.kinematics import preset
from viewsep.sim.camera import SimCamera
from viewsep.sim.clock import SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.render import CameraOptics, MeshRenderer
from viewsep.sim.world import SimWorld

Make = Callable[[Path, ExitStack], CameraCase]
"""From the mesh of an object to a camera that sees it; what must be closed at the end goes onto the stack."""


def simulated(start_ns: int = 0, disturbances: Disturbances | None = None) -> Make:
    def make(mesh: Path, stack: ExitStack) -> CameraCase:
        clock = SimClock(start_ns)
        world = SimWorld(preset("gimbal"), clock, 0, disturbances or Disturbances())
        stack.callback(world.close)
        return CameraCase(SimCamera(world, MeshRenderer(mesh, CameraOptics(48))), clock)

    return make


IMPLEMENTATIONS: dict[str, Make] = {
    "simulated": simulated(),
    "simulated, late and lossy": simulated(disturbances=Disturbances(latency_s=0.1, drop_rate=0.2)),
    "simulated, connected after an hour": simulated(3_600_000_000_123, Disturbances(drop_rate=0.2)),
}


@pytest.fixture(params=IMPLEMENTATIONS.values(), ids=list(IMPLEMENTATIONS))
def case(request: pytest.FixtureRequest, product_mesh: Path) -> Iterator[CameraCase]:
    with ExitStack() as stack:
        yield request.param(product_mesh, stack)


@pytest.mark.needs_pybullet
class TestCamera(CameraContract):
    pass
