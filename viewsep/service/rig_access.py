"""How the engine role reaches a rig: in the same process or across Zenoh, it looks the same."""

from __future__ import annotations

from typing import Protocol

from viewsep.config import Config
from viewsep.interfaces import Descriptor, Perception
from viewsep.service.status import LinkStatus
from viewsep.session import Rig


class RigAccess(Protocol):
    """A rig that the engine may use while it holds the rig's lease."""

    def setup(self, config: Config) -> tuple[Config, str]:
        """`config` with the rig's own sections (rig, camera, sim) as the rig says they are, and the source of what a
        simulated rig holds (empty where it is not known). Raises RigError."""
        ...

    def acquire(self, holder: str) -> None:
        """Take the lease. Raises Refused when somebody else has it or the rig has a fault, RigError."""
        ...

    def release(self, holder: str) -> None:
        """Give the lease back; does nothing when it is not held."""
        ...

    def rig(self, holder: str) -> Rig:
        """The rig for the session of `holder`."""
        ...

    def perception(self, holder: str, descriptor: Descriptor) -> Perception:
        """Where the percepts of `holder` come from."""
        ...

    def link(self) -> LinkStatus:
        """How the rig is reached now."""
        ...
