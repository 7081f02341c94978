"""The rig of a serving process: shared by its session, its commands, its streams and the engine's remote calls."""

from __future__ import annotations

from dataclasses import dataclass

from viewsep.config import Config
from viewsep.interfaces import Clock, Descriptor, Perception
from viewsep.kinematics import RigGeometry
from viewsep.perception import RigPerception
from viewsep.rigs import PictureKind
from viewsep.service.hardware import SharedCamera, SharedMotion
from viewsep.service.requests import Code, Refused
from viewsep.service.status import LinkStatus
from viewsep.session import Rig


@dataclass(frozen=True, slots=True)
class ServedRig:
    """Motion and camera that many callers share, and who may move them now.

    `config` is that of this rig; `holds` the source of what a simulated rig holds, empty on a real one; `speed` how
    many seconds pass on its clock in one, 0 where time passes only while somebody waits for it.
    """

    config: Config
    motion: SharedMotion
    camera: SharedCamera
    geometry: RigGeometry
    clock: Clock
    simulated: bool
    pictures: PictureKind | None
    holds: str
    speed: float

    def connect(self) -> None:
        """Open motion and camera. Raises RigError."""
        self.motion.connect()
        self.camera.connect()

    def close(self) -> None:
        """Stop the motion and release both: all is tried, then the first error is raised. Safe to call twice."""
        errors: list[BaseException] = []
        for close in (self.motion.close, self.camera.close):
            try:
                close()
            except BaseException as error:
                errors.append(error)
        if errors:
            raise errors[0]

    def rig(self, holder: str) -> Rig:
        """The rig for whoever holds the lease as `holder`."""
        return Rig(self.motion.commanded_by(holder), self.camera, self.geometry, self.clock)

    def acquire(self, holder: str) -> None:
        """Take the lease. Raises Refused when somebody else has it or the rig has a fault."""
        fault = self.motion.fault()
        if fault:
            raise Refused(Code.FAULT, f"{fault} (the request clear_fault tries to clear it)")
        self.motion.acquire(holder)


class LocalAccess:
    """`RigAccess` in the same process."""

    def __init__(self, served: ServedRig) -> None:
        self._served = served

    def setup(self, config: Config) -> tuple[Config, str]:
        """The configuration with this rig's own sections, and what it holds."""
        own = self._served.config
        sections = {"rig": own.rig, "camera": own.camera, "sim": own.sim}
        return config.model_copy(update=sections), self._served.holds

    def acquire(self, holder: str) -> None:
        """Take the lease. Raises Refused."""
        self._served.acquire(holder)

    def release(self, holder: str) -> None:
        """Give the lease back."""
        self._served.motion.release(holder)

    def rig(self, holder: str) -> Rig:
        """The rig itself."""
        return self._served.rig(holder)

    def perception(self, holder: str, descriptor: Descriptor) -> Perception:
        """Frames paired with read-backs in this process."""
        return RigPerception(self._served.rig(holder), descriptor)

    def link(self) -> LinkStatus:
        """There is nothing between engine and rig."""
        return LinkStatus(up=True, local=True, clock_offset_s=0.0, round_trip_s=0.0)
