"""How the engine role reaches a rig: in the same process or across Zenoh, it looks the same."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Protocol

from viewsep.calibration.compensation import compensated
from viewsep.config import Config, DescriptorConfig
from viewsep.interfaces import Perception
from viewsep.perception import RigPerception
from viewsep.perception.setup import finder_of
from viewsep.plugins import make_descriptor
from viewsep.service.looks import Send
from viewsep.service.names import Role
from viewsep.service.remote import RemoteRig
from viewsep.service.requests import Code, Refused
from viewsep.service.served_rig import RIG_SECTIONS, ServedRig
from viewsep.service.status import LinkStatus
from viewsep.session import Rig


class RigAccess(Protocol):
    """A rig that the engine borrows for a task."""

    def setup(self, config: Config) -> tuple[Config, str]:
        """The engine's configuration on this rig, and what it holds.

        The sections `RIG_SECTIONS` are the rig's own; what it holds is the source of a simulated object, empty
        where that is not known. Raises Refused when the rig cannot be reached, RigError.
        """
        ...

    def lent_to(self, holder: str) -> Rig:
        """The rig for one task: its motion's `connect` takes the lease, `close` gives it back."""
        ...

    def perception(self, rig: Rig, descriptor: DescriptorConfig) -> Perception:
        """Where the percepts of a task come from."""
        ...

    def link(self) -> LinkStatus:
        """How the rig is reached now."""
        ...

    def close(self) -> None:
        """End the link. Safe to call twice."""
        ...


class LocalAccess:
    """`RigAccess` in the same process."""

    def __init__(self, served: ServedRig) -> None:
        self._served = served

    def setup(self, config: Config) -> tuple[Config, str]:
        """The configuration with this rig's own sections, and what it holds."""
        own = self._served.config
        sections = {section: getattr(own, section) for section in RIG_SECTIONS}
        return config.model_copy(update=sections), self._served.holds

    def lent_to(self, holder: str) -> Rig:
        """The rig itself."""
        return self._served.lent_to(holder)

    def perception(self, rig: Rig, descriptor: DescriptorConfig) -> Perception:
        """Frames paired with read-backs in this process."""
        compensating = compensated(rig, self._served.config)
        return RigPerception(compensating, make_descriptor(descriptor), finder_of(self._served.config))

    def link(self) -> LinkStatus:
        """There is nothing between engine and rig."""
        return LinkStatus(up=True, local=True, clock_offset_s=0.0, round_trip_s=0.0)

    def close(self) -> None:
        """Nothing to end."""


class RemoteAccess:
    """`RigAccess` across Zenoh. `alive` tells which roles are there now."""

    def __init__(self, remote: RemoteRig, send: Send, alive: Callable[[], tuple[str, ...]]) -> None:
        self._remote = remote
        self._send = send
        self._alive = alive
        self._lock = threading.Lock()
        self._opened = False

    def setup(self, config: Config) -> tuple[Config, str]:
        """Ask the rig what it is: it may be another one than at the last task."""
        if Role.RIG not in self._alive():
            raise Refused(Code.RIG_LOST, "the rig is not there: start its process, or check key 'service.connect'")
        with self._lock:
            if self._opened:
                self._remote.describe()
            else:
                self._remote.open()
                self._opened = True
        return self._remote.config(config), self._remote.description.holds

    def lent_to(self, holder: str) -> Rig:
        """The rig over remote calls."""
        return self._remote.lent_to(holder)

    def perception(self, rig: Rig, descriptor: DescriptorConfig) -> Perception:
        """Frames paired with read-backs at the rig's side."""
        return self._remote.perception(descriptor, self._send)

    def link(self) -> LinkStatus:
        """Whether the last call was answered, and how far the clocks are apart."""
        link = self._remote.link
        up = link.up if self._opened else Role.RIG in self._alive()
        return LinkStatus(up=up, local=False, clock_offset_s=link.clock_offset_s, round_trip_s=link.round_trip_s)

    def close(self) -> None:
        """End the link."""
        self._remote.close()
