"""A rig in another process, as the engine's side sees it: the rig's interfaces over remote calls."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import zenoh

from viewsep.camera_config import CameraConfig, PerceptionConfig, StageConfig, V4l2Config
from viewsep.config import Config, DescriptorConfig, RigConfig, SimConfig, geometry_of
from viewsep.errors import BadInput, LeaseLost, NotConnected, RigError, RigLost
from viewsep.interfaces import JointLimits, Look
from viewsep.messages import Frame, JointState
from viewsep.plugins import make_descriptor
from viewsep.service.calls import MAX_WAIT_S
from viewsep.service.link import RigLink
from viewsep.service.looks import Send, decode_look, decode_picture
from viewsep.service.names import Keys
from viewsep.service.served_rig import RIG_SECTIONS
from viewsep.session import Rig

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class Description:
    """What the rig's side says of itself; see `ServedRig`."""

    rig: RigConfig
    camera: CameraConfig
    perception: PerceptionConfig
    sim: SimConfig
    stage: StageConfig
    v4l2: V4l2Config
    limits: tuple[JointLimits, ...]
    speed: float
    lease_s: float
    simulated: bool
    holds: str
    pictures: str


class RemoteRig:
    """A rig in another process. `open` asks what it is; `lent_to` gives it to a session for a task. A context manager.

    `session` belongs to the caller, who closes it after this. `resume_s` is how long a rig may be out of reach.
    """

    def __init__(self, session: zenoh.Session, keys: Keys, *, resume_s: float = 10.0) -> None:
        self.link = RigLink(session, keys, resume_s=resume_s)
        self._description: Description | None = None

    def __enter__(self) -> RemoteRig:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def open(self) -> None:
        """Find out what the rig is, and give signs of life from now on. Raises RigLost, RigError."""
        self.describe()
        self.link.open()

    def close(self) -> None:
        """End the link. Safe to call twice."""
        self.link.close()

    @property
    def description(self) -> Description:
        """What `describe` found last. Raises NotConnected before that."""
        if self._description is None:
            raise NotConnected("what the rig is was not asked yet: call describe() first")
        return self._description

    def describe(self) -> Description:
        """Ask anew what the rig is: it may have been started again with another object. Raises RigLost, RigError."""
        found = self.link.call("describe", _description)
        self._description = found
        self.link.follow_clock(found.speed, found.lease_s)
        return found

    def config(self, config: Config) -> Config:
        """The engine's configuration with what the rig's side decides: `RIG_SECTIONS`."""
        said = self.description
        return config.model_copy(update={section: getattr(said, section) for section in RIG_SECTIONS})

    def lent_to(self, holder: str) -> Rig:
        """The rig for one session, which takes the lease when it is entered and gives it back when it is left."""
        said = self.description
        geometry = replace(geometry_of(said.rig), limits=said.limits)
        clock = SteppedRemoteClock(self.link) if said.speed == 0.0 else RemoteClock(self.link)
        return Rig(RemoteMotion(self.link, holder, said.limits), RemoteCamera(self.link), geometry, clock)

    def perception(self, descriptor: DescriptorConfig, send: Send) -> RemotePerception:
        """Looks at the object, of which `send` comes over. Raises BadConfig for an unknown descriptor."""
        return RemotePerception(self.link, descriptor, send)


class RemoteMotion:
    """`MotionBackend` over a link. `connect` takes the lease, `close` stops and gives it back.

    What it raises is what the motion raised there, LeaseLost when somebody stopped or took the rig, and RigLost when
    it does not answer. While the rig is out of reach it holds its position; back in time, it goes on with its move.
    """

    def __init__(self, link: RigLink, holder: str, limits: tuple[JointLimits, ...]) -> None:
        self._link = link
        self._holder = holder
        self._limits = limits
        self._connected = False

    def connect(self) -> None:
        """Take the lease. Raises Refused (busy), RigLost, RigError."""
        self._link.acquire(self._holder)
        self._connected = True

    def limits(self) -> tuple[JointLimits, ...]:
        """The rig's limits as it described them."""
        return self._limits

    def move_to(self, position_rad: Sequence[float]) -> tuple[float, ...]:
        """Start moving."""
        return self._call("move_to", lambda said: _floats(said["commanded_rad"]), position_rad=list(position_rad))

    def read_state(self) -> JointState:
        """The newest read-back."""
        return self._call("state", lambda said: _state(said["state"]))

    def history(self, since_ns: int) -> tuple[JointState, ...]:
        """Read-backs from the last one at or before `since_ns` on."""
        return self._call("history", lambda said: tuple(map(_state, said["states"])), since_ns=since_ns)

    def stop(self) -> None:
        """Stop all joints and hold."""
        self._call("stop", _nothing)

    def fault(self) -> str:
        """The motion's fault."""
        return self._call("fault", lambda said: str(said["fault"])) if self._connected else ""

    def clear_fault(self) -> None:
        """Clear what can be cleared."""
        self._call("clear_fault", _nothing)

    def temperatures_c(self) -> tuple[float | None, ...]:
        """The newest temperature of every joint."""
        return self._call(
            "temperatures", lambda said: tuple(None if t is None else float(t) for t in said["temperatures_c"])
        )

    def counters(self) -> Mapping[str, int]:
        """What was counted on the way from the rig to its device."""
        return self._call("counters", lambda said: {str(name): int(count) for name, count in said["counters"].items()})

    def close(self) -> None:
        """Stop and give the lease back; nothing when it is lost, as the rig is held then anyway."""
        if self._connected:
            self._connected = False
            with suppress(LeaseLost, RigLost):
                self._link.release(self._holder)

    def _call(self, name: str, read: Callable[[Any], T], **arguments: Any) -> T:
        if not self._connected:
            raise NotConnected("the rig's motion is not connected: call connect() first")
        return self._link.call(name, read, holder=self._holder, **arguments)


class RemoteCamera:
    """`CameraSource` over a link: frames come as JPEG, their masks exactly. The device stays open at the rig's side."""

    def __init__(self, link: RigLink) -> None:
        self._link = link
        self._connected = False
        self._drops = 0

    def connect(self) -> None:
        """Allow reading."""
        self._connected = True

    def read(self, newer_than_ns: int, timeout_s: float) -> Frame:
        """The first frame exposed after `newer_than_ns`. Raises Timeout, LeaseLost, RigLost, RigError."""
        if not self._connected:
            raise NotConnected("the rig's camera is not connected: call connect() first")
        reply = self._link.ask("frame", self._link.wall_s(timeout_s), **_asked(self._link, newer_than_ns, timeout_s))
        frame, self._drops = decode_picture(reply)
        return frame

    @property
    def drops(self) -> int:
        """Exposures that never arrived, up to the newest frame that was read."""
        return self._drops

    def close(self) -> None:
        """No more reading."""
        self._connected = False


class RemotePerception:
    """`Perception` over a link: read-backs are paired with the frame at the rig's side.

    With `send` = "descriptor" the percept comes from there and no picture; otherwise the picture does, or the object
    cut out of it, and the feature is made here.
    """

    def __init__(self, link: RigLink, descriptor: DescriptorConfig, send: Send) -> None:
        self._link = link
        self._send = send
        self._descriptor = make_descriptor(descriptor)
        self._descriptor_said = descriptor.model_dump(mode="json")

    def look(self, newer_than_ns: int, timeout_s: float) -> Look:
        """The first look after `newer_than_ns`. Raises Timeout, LeaseLost, RigLost, RigError."""
        reply = self._link.ask(
            "look",
            2.0 * self._link.wall_s(timeout_s),  # for a frame, then for a read-back after it
            send=self._send,
            descriptor=self._descriptor_said,
            **_asked(self._link, newer_than_ns, timeout_s),
        )
        look = decode_look(reply)
        return look if self._send == "descriptor" else self._perceived(look)

    def _perceived(self, look: Look) -> Look:
        """The look with the feature of its picture."""
        if look.percept is None or look.frame is None:
            return look
        try:
            feature = self._descriptor.describe(look.frame.image, look.frame.mask)
        except BadInput as error:
            return Look(look.stamp_ns, look.frame, None, str(error))
        percept = replace(look.percept, descriptor=self._descriptor.name, feature=feature)
        return Look(look.stamp_ns, look.frame, percept)


class RemoteClock:
    """`Clock` of a rig whose time passes by itself: worked out from this machine's, and never going back."""

    def __init__(self, link: RigLink) -> None:
        self._link = link
        self._lock = threading.Lock()
        self._newest_ns: int | None = None

    def now_ns(self) -> int:
        """The rig's nanoseconds."""
        with self._lock:
            now_ns = self._link.clock.at(time.monotonic_ns())
            self._newest_ns = now_ns if self._newest_ns is None else max(now_ns, self._newest_ns)
            return self._newest_ns

    def sleep_until(self, stamp_ns: int) -> None:
        """Wait here until the rig's clock has come to `stamp_ns`."""
        while (left_ns := stamp_ns - self.now_ns()) > 0:
            time.sleep(self._link.wall_s(left_ns * 1e-9))


class SteppedRemoteClock:
    """`Clock` of a simulated rig whose time passes only when somebody waits for it."""

    def __init__(self, link: RigLink) -> None:
        self._link = link
        self._newest_ns = 0

    def now_ns(self) -> int:
        """The rig's nanoseconds; the newest that are known while it cannot be asked, as no time passes meanwhile."""
        with suppress(RigError):
            self._newest_ns = self._link.call("clock", _now_ns)
        return self._newest_ns

    def sleep_until(self, stamp_ns: int) -> None:
        """Let simulated time pass up to `stamp_ns`. Raises LeaseLost, RigLost, RigError."""
        while self._newest_ns < stamp_ns:
            step_ns = min(stamp_ns, self._newest_ns + round(MAX_WAIT_S * 1e9))
            self._newest_ns = self._link.call("sleep", _now_ns, until_ns=step_ns, holder=self._link.holder)


def _asked(link: RigLink, newer_than_ns: int, timeout_s: float) -> dict[str, Any]:
    return {"newer_than_ns": newer_than_ns, "timeout_s": float(timeout_s), "holder": link.holder}


def _description(said: Any) -> Description:
    return Description(
        RigConfig.model_validate(said["rig"]),
        CameraConfig.model_validate(said["camera"]),
        PerceptionConfig.model_validate(said["perception"]),
        SimConfig.model_validate(said["sim"]),
        StageConfig.model_validate(said["stage"]),
        V4l2Config.model_validate(said["v4l2"]),
        tuple(JointLimits(**limit) for limit in said["limits"]),
        float(said["speed"]),
        float(said["lease_s"]),
        bool(said["simulated"]),
        str(said["holds"]),
        str(said["pictures"]),
    )


def _state(said: Any) -> JointState:
    position, setpoint = _floats(said["position_rad"]), _floats(said["setpoint_rad"])
    return JointState(int(said["stamp_ns"]), position, setpoint, bool(said["moving"]), str(said["fault"]))


def _now_ns(said: Any) -> int:
    return int(said["now_ns"])


def _floats(values: Any) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def _nothing(_said: Any) -> None:
    return None
