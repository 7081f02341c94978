"""The rig of a serving process: shared by its session, its commands, its streams and the engine's remote calls."""

from __future__ import annotations

from dataclasses import dataclass

from viewsep.config import Config
from viewsep.errors import NotConnected, try_all
from viewsep.interfaces import CameraSource, Clock
from viewsep.kinematics import RigGeometry
from viewsep.messages import Frame
from viewsep.service.hardware import SharedCamera, SharedMotion
from viewsep.session import Rig

RIG_SECTIONS = ("rig", "camera", "perception", "sim", "stage", "v4l2")
"""Sections of the configuration that are the rig's own, wherever the engine is: how it moves, sees, finds objects."""


@dataclass(frozen=True, slots=True)
class ServedRig:
    """The hardware of a process that serves a rig, and what is to be known of it.

    `speed` is that of the rig's time against the wall's: 1 for real rigs, 0 for a simulation that is stepped. `holds`
    and `pictures` are what a simulated rig shows and where its pictures come from.
    """

    motion: SharedMotion
    camera: SharedCamera
    geometry: RigGeometry
    clock: Clock
    config: Config
    speed: float = 1.0
    simulated: bool = False
    holds: str = ""
    pictures: str = ""

    def connect(self) -> None:
        """Open motion and camera. Raises RigError."""
        self.motion.connect()
        self.camera.connect()

    def close(self) -> None:
        """Stop the motion and release both: all is tried, then the first error is raised. Safe to call twice."""
        try_all((self.motion.close, self.camera.close))

    def lent_to(self, holder: str) -> Rig:
        """The rig for one session in this process: opening and closing it takes and returns the lease, no more."""
        return Rig(self.motion.commanded_by(holder), _Lent(self.camera), self.geometry, self.clock)


class _Lent:
    """A camera that is read by whoever opened it here, while the device is opened and closed by who serves it."""

    def __init__(self, camera: CameraSource) -> None:
        self._camera = camera
        self._open = False

    def connect(self) -> None:
        self._open = True

    def read(self, newer_than_ns: int, timeout_s: float) -> Frame:
        if not self._open:
            raise NotConnected("the camera is not connected: call connect() first")
        return self._camera.read(newer_than_ns, timeout_s)

    @property
    def drops(self) -> int:
        return self._camera.drops

    def close(self) -> None:
        self._open = False
