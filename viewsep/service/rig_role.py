"""The role that holds the hardware: moves, stops, faults, and the streams of what the rig does."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress

import numpy as np

from viewsep.errors import BadInput, RigError
from viewsep.geometry import spherical_direction
from viewsep.interfaces import Listener
from viewsep.service.answering import Answer
from viewsep.service.presence import check_present
from viewsep.service.requests import (
    ClearFaultRequest,
    Code,
    HomeRequest,
    MoveRequest,
    Refused,
    StopRequest,
    accepted,
    parse_request,
)
from viewsep.service.served_rig import ServedRig
from viewsep.service.status import CameraStatus, JointStatus, MotionStatus, RigStatus
from viewsep.session import SETTLED_RAD

log = logging.getLogger("viewsep.service.rig")
POLL_S = 0.02
POLL_NS = 20_000_000


class RigRole:
    """Serves one rig. All public functions may be called from any thread.

    `connect` opens the hardware and begins to publish read-backs to `listener`; `close` stops and releases it. An
    error that nobody expected ends the service: `on_crash` is called with it.
    """

    def __init__(
        self,
        served: ServedRig,
        listener: Listener,
        move_timeout_s: float,
        on_crash: Callable[[Exception], None],
        present: Callable[[str], bool],
        connections: Callable[[], tuple[str, ...]],
    ) -> None:
        self._served = served
        self._listener = listener
        self._move_timeout_s = move_timeout_s
        self._on_crash = on_crash
        self._present = present
        self._connections = connections
        self._lock = threading.RLock()
        self._move: _Move | None = None
        self._closing = threading.Event()
        self._threads: list[threading.Thread] = []
        self._since = time.monotonic()

    def connect(self) -> None:
        """Open motion and camera. Raises RigError; everything is closed again then."""
        try:
            self._served.connect()
        except BaseException:
            self.close()
            raise
        self._spawn(self._publish_read_backs, "viewsep read-backs")

    def answers(self) -> Mapping[str, Answer]:
        """The commands of this role."""
        return {"home": self.home, "move": self.move, "clear_fault": self.clear_fault}

    def home(self, payload: bytes) -> bytes:
        """Drive to the home position. Raises Refused, RigError."""
        request = parse_request("home", payload)
        assert isinstance(request, HomeRequest)
        near = self._served.motion.read_state().position_rad
        return self._begin_move("home", request.owner, request.token, self._served.geometry.home(near))

    def move(self, payload: bytes) -> bytes:
        """Drive to joint angles or to a view direction. Raises Refused."""
        request = parse_request("move", payload)
        assert isinstance(request, MoveRequest)
        return self._begin_move("move", request.owner, request.token, self._goal(request))

    def stop(self, request: StopRequest) -> None:
        """Stop at once and hold; whoever may move the rig loses the lease."""
        reason = f"stopped by {request.owner}" + (f": {request.reason}" if request.reason else "")
        self._served.motion.halt(reason)
        log.warning(reason)

    def clear_fault(self, payload: bytes) -> bytes:
        """Clear what can be cleared. Raises Refused with what remains."""
        request = parse_request("clear_fault", payload)
        assert isinstance(request, ClearFaultRequest)
        holder = f"clear_fault of {request.owner}"
        motion = self._served.motion
        motion.acquire(holder)
        try:
            motion.clear_fault()
        except RigError as error:
            raise Refused(Code.FAULT, str(error)) from error
        finally:
            motion.release(holder)
        return accepted("clear_fault")

    def owner_gone(self, token: str) -> None:
        """The client whose token this was has gone: its move stops and the position is held."""
        with self._lock:
            move = self._move
        if move is not None and token and move.token == token:
            log.warning("the owner of a move, %s, has gone: holding position", move.owner)
            self._served.motion.halt(f"{move.owner} has gone")

    def engine_gone(self) -> None:
        """The engine's process has gone, or its link: whatever it moves is held until it is heard again."""
        lease = self._served.motion.lease
        holder = lease.holder
        with self._lock:
            own = self._move is not None and self._move.holder == holder
        if holder and not own:
            log.warning("the engine has gone during %s: holding position", holder)
            lease.lapse(holder)

    def status(self) -> RigStatus:
        """The rig's section of the status."""
        served = self._served
        motion, faults = self._motion_status()
        health = served.camera.health()
        camera = CameraStatus(
            connected=health.connected, rate_hz=health.rate_hz, newest_age_s=health.newest_age_s, drops=health.drops
        )
        if health.problem:
            faults = (*faults, health.problem)
        return RigStatus(
            simulated=served.simulated,
            clock_ns=served.clock.now_ns(),
            speed=served.speed,
            holds=served.holds,
            motion=motion,
            camera=camera,
            faults=faults,
            connections=self._connections(),
            uptime_s=time.monotonic() - self._since,
        )

    def close(self) -> None:
        """Stop the motion and release everything: all is tried, then the first error is raised. Safe to call twice."""
        self._closing.set()
        self._served.motion.lease.revoke("the service is shutting down")
        try:
            self._served.close()
        finally:
            for thread in self._threads:
                if thread is not threading.current_thread():
                    thread.join()
            self._threads = []

    def _motion_status(self) -> tuple[MotionStatus, tuple[str, ...]]:
        motion, lease = self._served.motion, self._served.motion.lease
        holder = "" if lease.lapsed() else lease.holder  # from one who has lapsed anybody may take the rig
        try:
            state, temperatures, fault = motion.read_state(), motion.temperatures_c(), motion.fault()
        except RigError as error:
            return MotionStatus(connected=False, fault=str(error), holder=holder), (str(error),)
        limits = motion.limits()
        joints = tuple(
            JointStatus(
                name=limit.name,
                position_deg=float(np.degrees(position)),
                setpoint_deg=float(np.degrees(setpoint)),
                temperature_c=temperature,
            )
            for limit, position, setpoint, temperature in zip(
                limits, state.position_rad, state.setpoint_rad, temperatures, strict=True
            )
        )
        fault = fault or state.fault
        counters = dict(motion.counters())
        status = MotionStatus(
            connected=True, joints=joints, moving=state.moving, fault=fault, holder=holder, counters=counters
        )
        return status, (fault,) if fault else ()

    def _goal(self, request: MoveRequest) -> tuple[float, ...]:
        """Joint angles in radians. Raises Refused where the rig cannot show the view."""
        if request.joints_deg is not None:
            return tuple(float(q) for q in np.radians(request.joints_deg))
        assert request.view_deg is not None
        view = spherical_direction(*np.radians(request.view_deg))
        near = self._served.motion.read_state().position_rad
        try:
            return self._served.geometry.joints_for(view, near)
        except (RigError, BadInput) as error:
            raise Refused(Code.UNREACHABLE, str(error)) from error

    def _begin_move(self, command: str, owner: str, token: str, goal: Sequence[float]) -> bytes:
        """Start a move; it replaces one of the same owner that is under way. Raises Refused."""
        if self._closing.is_set():
            raise Refused(Code.UNAVAILABLE, "the service is shutting down")
        check_present(token, self._present)
        holder = f"a move of {owner}"
        with self._lock:
            replaces = self._move is not None and self._move.holder == holder
            self._served.motion.acquire(holder)
            try:
                setpoint = self._served.motion.commanded_by(holder).move_to(goal)
            except RigError as error:
                if not replaces:
                    self._served.motion.release(holder)
                raise Refused(Code.UNREACHABLE, str(error)) from error
            self._move = move = _Move(holder, owner, token, tuple(setpoint))
        self._spawn(lambda: self._watch(move), "viewsep move")
        if token and not self._present(token):  # it went away while the move began
            self.owner_gone(token)
        return accepted(command, setpoint_deg=[float(q) for q in np.degrees(setpoint)])

    def _watch(self, move: _Move) -> None:
        """Hold the lease until the joints have settled, then give it back. Stops what does not settle in time."""
        clock = self._served.clock
        motion = self._served.motion.commanded_by(move.holder)
        deadline_ns = clock.now_ns() + round(self._move_timeout_s * 1e9)
        try:
            while self._move is move and not self._closing.is_set():
                clock.sleep_until(clock.now_ns() + POLL_NS)
                state = motion.read_state()
                away = max(abs(q - goal) for q, goal in zip(state.position_rad, move.setpoint_rad, strict=True))
                if not state.moving and away < SETTLED_RAD:
                    return
                if clock.now_ns() > deadline_ns:
                    log.error("%s did not settle within %g s: stopped", move.holder, self._move_timeout_s)
                    return
        except RigError as error:
            log.warning("%s ended: %s", move.holder, error)
        finally:
            self._end_move(move)

    def _end_move(self, move: _Move) -> None:
        """Stop and give the lease back, unless another move has replaced this one."""
        with self._lock, suppress(RigError):  # the status tells of an error
            if self._move is move:
                self._move = None
                self._served.motion.release(move.holder)

    def _publish_read_backs(self) -> None:
        """Pass every read-back on, once."""
        newest_ns = -1
        while not self._closing.wait(POLL_S):
            try:
                for state in self._served.motion.history(newest_ns):
                    if state.stamp_ns > newest_ns:
                        newest_ns = state.stamp_ns
                        self._listener.hear(state.stamp_ns, state)
            except RigError:
                continue  # the status says so

    def _spawn(self, work: Callable[[], None], name: str) -> None:
        """A thread whose unexpected errors end the service."""

        def run() -> None:
            try:
                work()
            except Exception as error:
                if not self._closing.is_set():
                    self._on_crash(error)

        self._threads = [thread for thread in self._threads if thread.is_alive()]
        self._threads.append(threading.Thread(target=run, name=name))
        self._threads[-1].start()


class _Move:
    """A move somebody asked for."""

    def __init__(self, holder: str, owner: str, token: str, setpoint_rad: tuple[float, ...]) -> None:
        self.holder, self.owner, self.token, self.setpoint_rad = holder, owner, token, setpoint_rad
