"""The one loop that does the I/O: frames and read-backs in, commands out, deadlines kept, everything heard."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import nullcontext, suppress
from dataclasses import dataclass

import numpy as np

from viewsep.engine.engine import Engine
from viewsep.engine.state import EngineState
from viewsep.errors import MoveRefused, RigError, Timeout, UnreachableView, try_all
from viewsep.interfaces import CameraSource, Clock, Listener, MotionBackend, Perception
from viewsep.kinematics import RigGeometry
from viewsep.messages import (
    CancelRequested,
    Command,
    DeadlinePassed,
    Event,
    FrameMissing,
    JointState,
    Keyframe,
    Message,
    MoveFailed,
    MoveSettled,
    MoveTo,
    PerceptReceived,
    Result,
    RigFailed,
    TaskStarted,
)

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
    keyframe_s: float = 5.0  # how often the engine's state is told, 0 for never


@dataclass
class _Move:
    command: MoveTo
    setpoint_rad: tuple[float, ...]
    deadline_ns: int


class Session:
    """Runs separation tasks on a rig. A context manager: leaving it stops the motion and closes everything.

    Where the last task failed because the rig did, an error of closing it says nothing new and is not raised.
    """

    def __init__(
        self,
        rig: Rig,
        engine: Engine,
        perception: Perception,
        pace: Pace | None = None,
        listeners: Sequence[Listener] = (),
    ) -> None:
        self.rig = rig
        self.engine = engine
        self.perception = perception
        self.pace = pace or Pace()
        self.listeners = listeners
        self.state: EngineState = engine.start()
        self._cancelled = ""
        self._broken = False
        self._move: _Move | None = None
        self._heard_until_ns = -1
        self._keyframe_due_ns = 0

    def __enter__(self) -> Session:
        try:
            self.rig.motion.connect()
            self.rig.camera.connect()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(RigError) if self._broken else nullcontext():  # the result says it already
            self.close()

    def close(self) -> None:
        """Stop the motion and close motion and camera: all is tried, then the first error is raised."""
        try_all((self.rig.motion.close, self.rig.camera.close))

    def cancel(self, reason: str) -> None:
        """Ask the running task to end; may be called from a signal handler or another thread."""
        self._cancelled = reason

    def run(self, seed: int) -> Result:
        """Carry out one task. A rig that fails on the way ends it as failed; raises RigError when it cannot begin."""
        clock = self.rig.clock
        self.state = self.engine.start()
        self._broken = False
        self._move = None
        self._keyframe_due_ns = 0
        start = self._newest_state()
        view = self.rig.geometry.view_direction(start.position_rad)
        try:
            self._feed(TaskStarted(clock.now_ns(), seed, view))
            self._loop()
        except RigError as error:
            self._move = None
            self._broken = True
            with suppress(RigError):  # a rig that fails may not even stop: closing it tries again and tells
                self._feed(RigFailed(clock.now_ns(), str(error)))
        finally:
            self._cancelled = ""
        assert self.state.result is not None
        return self.state.result

    def _loop(self) -> None:
        """Look, watch and feed until there is a result."""
        clock, pace = self.rig.clock, self.pace
        deadline_ns = clock.now_ns() + round(pace.deadline_s * 1e9)
        last_look_ns = clock.now_ns()
        while self.state.result is None:
            last_look_ns = self._look(self._wait(last_look_ns + round(pace.look_period_s * 1e9)), last_look_ns)
            if self._cancelled:
                self._feed(CancelRequested(clock.now_ns(), self._cancelled))
            elif clock.now_ns() > deadline_ns:
                self._feed(DeadlinePassed(clock.now_ns()))

    def _wait(self, until_ns: int) -> int:
        """Watch the motion until it is time for the next look; returns that time."""
        clock = self.rig.clock
        self._watch_motion()
        while clock.now_ns() < until_ns and self.state.result is None and not self._cancelled:
            clock.sleep_until(min(until_ns, clock.now_ns() + POLL_NS))
            self._watch_motion()
        return until_ns

    def _look(self, due_ns: int, last_look_ns: int) -> int:
        """Take the look that is due and feed what it gave; returns the time of this look."""
        if self.state.result is not None or self._cancelled:
            return last_look_ns
        try:
            look = self.perception.look(due_ns - 1, self.pace.frame_timeout_s)
        except Timeout as error:
            self._feed(FrameMissing(self.rig.clock.now_ns(), str(error)))
            return self.rig.clock.now_ns()
        if look.frame is not None:
            self._tell(look.stamp_ns, look.frame)
        self._hear_motion(self.rig.motion.history(self._heard_until_ns))
        if look.percept is None:
            self._feed(FrameMissing(look.stamp_ns, look.problem))
        else:
            self._feed(PerceptReceived(look.percept))
        return look.stamp_ns

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
            if self.state.interpretation is not before.interpretation:
                hypotheses = self.engine.interpreter.hypotheses(self.state.interpretation, event.stamp_ns)
                self._tell(event.stamp_ns, hypotheses)
        for command in commands:
            self._tell(event.stamp_ns, command)
        if self.state.result is not None and before.result is None:
            self._tell(event.stamp_ns, self.state.result)
        self._keep_state(event.stamp_ns)
        for command in commands:
            self._carry_out(command)

    def _keep_state(self, stamp_ns: int) -> None:
        """Tell the engine's state when it is due, so that a replay can begin here; at the first event it is."""
        due = stamp_ns >= self._keyframe_due_ns and self.state.result is None
        if due and self.pace.keyframe_s > 0 and self.listeners:
            self._keyframe_due_ns = stamp_ns + round(self.pace.keyframe_s * 1e9)
            self._tell(stamp_ns, Keyframe(stamp_ns, self.engine.save(self.state)))

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
