"""The one loop that does the I/O: frames and read-backs in, commands out, deadlines kept, everything heard."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from viewsep.engine.engine import Engine
from viewsep.engine.state import EngineState
from viewsep.errors import BadInput, MoveRefused, Timeout, UnreachableView
from viewsep.interfaces import CameraSource, Clock, Descriptor, Listener, MotionBackend
from viewsep.kinematics import RigGeometry
from viewsep.messages import (
    CancelRequested,
    Command,
    DeadlinePassed,
    Event,
    FrameMissing,
    JointState,
    Message,
    MoveFailed,
    MoveSettled,
    MoveTo,
    PerceptReceived,
    Result,
    TaskStarted,
)
from viewsep.perception import perceive

POLL_NS = 20_000_000
SETTLED_RAD = np.radians(0.5)


@dataclass(frozen=True, slots=True)
class Rig:
    """One motion backend, one camera, their geometry and their clock."""

    motion: MotionBackend
    camera: CameraSource
    geometry: RigGeometry
    clock: Clock


@dataclass(frozen=True, slots=True)
class Pace:
    """Deadlines and rates of the loop."""

    look_period_s: float = 0.25
    frame_timeout_s: float = 1.0
    move_timeout_s: float = 15.0
    deadline_s: float = 600.0


@dataclass
class _Move:
    command: MoveTo
    setpoint_rad: tuple[float, ...]
    deadline_ns: int


class Session:
    """Runs separation tasks on a rig. A context manager: leaving it stops the motion and closes everything."""

    def __init__(
        self,
        rig: Rig,
        engine: Engine,
        descriptor: Descriptor,
        pace: Pace | None = None,
        listeners: Sequence[Listener] = (),
    ) -> None:
        self.rig = rig
        self.engine = engine
        self.descriptor = descriptor
        self.pace = pace or Pace()
        self.listeners = listeners
        self.state: EngineState = engine.start()
        self._cancelled = ""
        self._move: _Move | None = None
        self._heard_until_ns = -1

    def __enter__(self) -> Session:
        try:
            self.rig.motion.connect()
            self.rig.camera.connect()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop the motion and close motion and camera: all is tried, then the first error is raised."""
        errors: list[BaseException] = []
        for close in (self.rig.motion.close, self.rig.camera.close):
            try:
                close()
            except BaseException as error:
                errors.append(error)
        if errors:
            raise errors[0]

    def cancel(self, reason: str) -> None:
        """Ask the running task to end; may be called from a signal handler or another thread."""
        self._cancelled = reason

    def run(self, seed: int) -> Result:
        """Carry out one task. Raises RigError when the rig fails in a way that leaves nothing to decide."""
        clock, pace = self.rig.clock, self.pace
        self.state = self.engine.start()
        self._move = None
        deadline_ns = clock.now_ns() + round(pace.deadline_s * 1e9)
        start = self._newest_state()
        view = self.rig.geometry.view_direction(start.position_rad)
        self._feed(TaskStarted(clock.now_ns(), seed, view))
        last_look_ns = clock.now_ns()
        while self.state.result is None:
            last_look_ns = self._look(self._wait(last_look_ns + round(pace.look_period_s * 1e9)), last_look_ns)
            if self._cancelled:
                self._feed(CancelRequested(clock.now_ns(), self._cancelled))
            elif clock.now_ns() > deadline_ns:
                self._feed(DeadlinePassed(clock.now_ns()))
        self._cancelled = ""
        return self.state.result

    def _wait(self, until_ns: int) -> int:
        """Watch the motion until it is time for the next look; returns that time."""
        clock = self.rig.clock
        self._watch_motion()
        while clock.now_ns() < until_ns and self.state.result is None and not self._cancelled:
            clock.sleep_until(min(until_ns, clock.now_ns() + POLL_NS))
            self._watch_motion()
        return until_ns

    def _look(self, due_ns: int, last_look_ns: int) -> int:
        """Read the frame that is due, turn it into a percept, feed it; returns the time of this look."""
        if self.state.result is not None or self._cancelled:
            return last_look_ns
        try:
            frame = self.rig.camera.read(due_ns - 1, self.pace.frame_timeout_s)
        except Timeout as error:
            self._feed(FrameMissing(self.rig.clock.now_ns(), str(error)))
            return self.rig.clock.now_ns()
        self._tell(frame.stamp_ns, frame)
        try:
            history = self._history_around(frame.stamp_ns)
            percept = perceive(frame, history, self.rig.geometry, self.descriptor)
        except (Timeout, BadInput) as error:
            self._feed(FrameMissing(frame.stamp_ns, str(error)))
        else:
            self._feed(PerceptReceived(percept))
        return frame.stamp_ns

    def _history_around(self, stamp_ns: int) -> tuple[JointState, ...]:
        """Read-backs around a moment; waits for the one after it."""
        clock = self.rig.clock
        deadline_ns = clock.now_ns() + round(self.pace.frame_timeout_s * 1e9)
        history = self.rig.motion.history(stamp_ns)
        while (not history or history[-1].stamp_ns < stamp_ns) and clock.now_ns() < deadline_ns:
            clock.sleep_until(clock.now_ns() + POLL_NS // 4)
            history = self.rig.motion.history(stamp_ns)
        self._hear_motion(history)
        return history

    def _newest_state(self) -> JointState:
        state = self.rig.motion.read_state()
        self._tell(state.stamp_ns, state)
        self._heard_until_ns = state.stamp_ns
        return state

    def _watch_motion(self) -> None:
        """Pass on new read-backs and notice when the move has settled, failed or taken too long."""
        self._hear_motion(self.rig.motion.history(self._heard_until_ns))
        if self._move is None:
            return
        move, now = self._move, self.rig.clock.now_ns()
        state = self.rig.motion.read_state()
        fault = state.fault or self.rig.motion.fault()
        away = max(abs(q - goal) for q, goal in zip(state.position_rad, move.setpoint_rad, strict=True))
        if fault:
            self._settle(MoveFailed(now, move.command.command_id, fault))
        elif not state.moving and away < SETTLED_RAD:
            self._settle(MoveSettled(now, move.command.command_id))
        elif now > move.deadline_ns:
            reason = (
                f"the joints did not arrive within {self.pace.move_timeout_s:g} s ({np.degrees(away):.1f} deg away)"
            )
            self._settle(MoveFailed(now, move.command.command_id, reason))

    def _hear_motion(self, history: Sequence[JointState]) -> None:
        """Pass on the read-backs that were not passed on before."""
        for state in history:
            if state.stamp_ns > self._heard_until_ns:
                self._tell(state.stamp_ns, state)
                self._heard_until_ns = state.stamp_ns

    def _settle(self, event: MoveSettled | MoveFailed) -> None:
        self._move = None
        self._feed(event)

    def _feed(self, event: Event) -> None:
        """One step of the engine: the event is heard, then what came of it, then the commands are carried out."""
        self._tell(event.stamp_ns, event)
        before = self.state
        self.state, commands = self.engine.step(before, event)
        if self.state.estimate is not None and self.state.estimate is not before.estimate:
            self._tell(event.stamp_ns, self.state.estimate)
        for command in commands:
            self._tell(event.stamp_ns, command)
        if self.state.result is not None and before.result is None:
            self._tell(event.stamp_ns, self.state.result)
        for command in commands:
            self._carry_out(command)

    def _carry_out(self, command: Command) -> None:
        now = self.rig.clock.now_ns()
        if not isinstance(command, MoveTo):
            self._move = None
            self.rig.motion.stop()
            return
        try:
            near = self.rig.motion.read_state().position_rad
            commanded = self.rig.motion.move_to(self.rig.geometry.joints_for(command.view_direction, near))
        except (MoveRefused, UnreachableView) as error:
            self._feed(MoveFailed(now, command.command_id, str(error)))
            return
        self._move = _Move(command, commanded, now + round(self.pace.move_timeout_s * 1e9))

    def _tell(self, stamp_ns: int, message: Message) -> None:
        for listener in self.listeners:
            listener.hear(stamp_ns, message)
