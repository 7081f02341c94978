"""From configuration to a rig that a session can run on."""

from __future__ import annotations

from dataclasses import dataclass

from viewsep.config import Config, geometry_of
from viewsep.messages import FloatArray
from viewsep.session import Pace, Rig
from viewsep.sim.camera import SimCamera
from viewsep.sim.clock import SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.motion import SimMotion
from viewsep.sim.render import CameraOptics
from viewsep.sim.render_cache import RenderCache
from viewsep.sim.source import open_renderer
from viewsep.sim.world import SimWorld


@dataclass(frozen=True, slots=True)
class SimulatedRig:
    """A rig whose truth is known: the world, and the digest of the mesh in its holder."""

    rig: Rig
    world: SimWorld
    object_digest: str

    def true_rotation(self, stamp_ns: int) -> FloatArray:
        """(3, 3) object -> control at a moment."""
        return self.world.grasp_at(stamp_ns)


def simulated_rig(config: Config, source: str, seed: int, cache: RenderCache | None = None) -> SimulatedRig:
    """The simulated rig holding an object in an unknown grasp drawn from the seed. Raises BadInput, BadMesh."""
    geometry, clock = geometry_of(config.rig), SimClock()
    disturbances = Disturbances(**config.sim.model_dump())
    renderer = open_renderer(source, CameraOptics(config.camera.size_px), cache)
    world = SimWorld(geometry, clock, seed, disturbances)
    camera = SimCamera(world, renderer, config.camera.rate_hz, seed)
    return SimulatedRig(Rig(SimMotion(world, seed), camera, geometry, clock), world, renderer.mesh.digest)


def pace_of(config: Config) -> Pace:
    """The loop's rates and deadlines."""
    task = config.task
    return Pace(1.0 / task.looks_per_s, task.frame_timeout_s, task.move_timeout_s, task.deadline_s)
