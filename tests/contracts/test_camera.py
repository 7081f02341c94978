"""The camera contract on every camera: add one factory per implementation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from camera_contract import CameraCase, CameraContract
from fake_camera import FakeCamera
from rig_on_zenoh import remote_rig, station
from view_sets import ring, write_view_set

from viewsep.camera_config import CameraConfig
from viewsep.clock import MonotonicClock
from viewsep.config import Config, SimConfig
from viewsep.drivers.v4l2.camera import V4l2Camera
from viewsep.drivers.v4l2.settings import V4l2Settings
from viewsep.kinematics import preset
from viewsep.service.hardware import SharedCamera
from viewsep.sim.camera import SimCamera
from viewsep.sim.clock import PacedClock, SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.plate import PhotoPlate, Photos
from viewsep.sim.render import CameraOptics, MeshRenderer
from viewsep.sim.stage import Stage, Staging
from viewsep.sim.staged_camera import Delivery, StagedCamera
from viewsep.sim.view_set import read_view_set
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


def photos(disturbances: Disturbances | None = None) -> Make:
    def make(mesh: Path, stack: ExitStack) -> CameraCase:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        view_set = read_view_set(write_view_set(folder / "tin", 1, ring(*range(0, 360, 30)), masks=False))
        clock = SimClock()
        rests = -np.radians(view_set.angles_deg[:, :1])
        world = PhotoPlate(preset("turntable", 20.0), clock, disturbances or Disturbances(), rests, 0.0)
        stack.callback(world.close)
        return CameraCase(SimCamera(world, Photos(view_set, range(12), 48)), clock)

    return make


def staged(delivery: Delivery | None = None, start_ns: int = 0) -> Make:
    def make(mesh: Path, stack: ExitStack) -> CameraCase:
        clock = SimClock(start_ns)
        world = SimWorld(preset("turntable"), clock, 0, Disturbances())
        stack.callback(world.close)
        stage = Stage(Staging(plate=True, gripper=True, size=(96, 72), object_px=40))
        pictures = MeshRenderer(mesh, CameraOptics(40))
        return CameraCase(
            StagedCamera(world, pictures, stage, lambda stamp_ns: world.load_at(stamp_ns).tolist(), delivery), clock
        )

    return make


def shared(speed: float, disturbances: Disturbances | None = None) -> Make:
    """Shared with other readers, in stepped time or in real time that is `speed` times as fast."""

    def make(mesh: Path, stack: ExitStack) -> CameraCase:
        clock = PacedClock(speed) if speed else SimClock()
        world = SimWorld(preset("gimbal"), clock, 0, disturbances or Disturbances())
        stack.callback(world.close)
        camera = SimCamera(world, MeshRenderer(mesh, CameraOptics(48)))
        return CameraCase(SharedCamera(camera, clock, stepped=speed == 0.0), clock)

    return make


def remote(speed: float, disturbances: SimConfig | None = None) -> Make:
    """Read from the other end of a connection."""

    def make(_mesh: Path, stack: ExitStack) -> CameraCase:
        config = Config(camera=CameraConfig(size_px=48), sim=disturbances or SimConfig())
        rig = stack.enter_context(remote_rig(stack.enter_context(station(config, speed=speed)))).lent_to("a contract")
        return CameraCase(rig.camera, rig.clock)

    return make


def v4l2(lossy: bool = False, format: str = "MJPG") -> Make:
    """The driver on a camera as OpenCV and the kernel show it."""

    def make(_mesh: Path, stack: ExitStack) -> CameraCase:
        folder = Path(stack.enter_context(TemporaryDirectory()))
        device = FakeCamera(folder, lost=(lambda number: number % 7 == 3) if lossy else (lambda number: False))
        settings = V4l2Settings(str(device.by_id), format, 64, 48, 50)
        camera = V4l2Camera(settings, MonotonicClock(), device.system)
        stack.callback(camera.close)
        return CameraCase(camera, MonotonicClock())

    return make


IMPLEMENTATIONS: dict[str, Make] = {
    "simulated": simulated(),
    "simulated, late and lossy": simulated(disturbances=Disturbances(latency_s=0.1, drop_rate=0.2)),
    "simulated, connected after an hour": simulated(3_600_000_000_123, Disturbances(drop_rate=0.2)),
    "photos": photos(),
    "photos, late, lossy and noisy": photos(Disturbances(latency_s=0.1, drop_rate=0.2, noise=0.1, mask_error=0.1)),
    "staged": staged(),
    "staged, late and lossy, connected after an hour": staged(
        Delivery(latency_s=0.1, drop_rate=0.2, buffers=2), 3_600_000_000_123
    ),
    "shared, stepped": shared(0.0, Disturbances(latency_s=0.1, drop_rate=0.2)),
    "shared, real time": shared(2.0),
    "shared, real time, late and lossy": shared(2.0, Disturbances(latency_s=0.1, drop_rate=0.2)),
    "remote, stepped": remote(0.0, SimConfig(latency_s=0.1, drop_rate=0.2)),
    "remote, real time": remote(2.0),
    "v4l2": v4l2(),
    "v4l2, lossy, not compressed": v4l2(lossy=True, format="YUYV"),
}


def marked(name: str) -> pytest.ParameterSet:
    marks = [] if name.startswith(("photos", "v4l2")) else [pytest.mark.needs_pybullet]
    return pytest.param(IMPLEMENTATIONS[name], marks=marks, id=name)


@pytest.fixture(params=[marked(name) for name in IMPLEMENTATIONS])
def case(request: pytest.FixtureRequest, product_mesh: Path) -> Iterator[CameraCase]:
    with ExitStack() as stack:
        yield request.param(product_mesh, stack)


class TestCamera(CameraContract):
    pass
