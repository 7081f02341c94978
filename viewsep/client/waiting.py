"""Waiting for tasks and moves: from the status, woken up by the result stream; deadlines on the monotonic clock."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

from viewsep.client.errors import NoAnswer, TaskLost
from viewsep.client.streams import Received, Stream
from viewsep.errors import RigError, Timeout, ViewsepError
from viewsep.messages import Result
from viewsep.service.status import MotionStatus, ResultStatus, Status

LOOK_S = 0.5
"""How often the status is asked for while nothing happens."""
SETTLED_DEG = 1.0
"""How far from its goal a joint that stands still may be."""


def wait_for_result(
    task: str,
    ask: Callable[[], Status],
    stream: Stream,
    heard: Callable[[Received], None],
    timeout_s: float,
    grace_s: float,
    interrupted: Callable[[], bool] = lambda: False,
) -> ResultStatus:
    """How `task` ended. `ask` gives the status; `heard` gets every message of `stream`, which must carry the results.

    `interrupted` is asked now and then and ends the waiting with KeyboardInterrupt. Raises Timeout; TaskLost, NoAnswer
    when for `grace_s` the service does not know the task, or does not answer.
    """
    deadline = time.monotonic() + timeout_s
    running, result = False, None
    trouble_since: float | None = None
    while True:
        if interrupted():
            raise KeyboardInterrupt
        trouble: ViewsepError | None = None
        try:
            said = ask().engine
        except NoAnswer as error:
            trouble = NoAnswer(f"the service went away while task {task} ran: {error}")
        else:
            if said is None:
                trouble = NoAnswer(f"the engine went away while task {task} ran: only the rig answers")
            elif said.result is not None and said.result.task == task:
                _hear(stream, heard, 0.0)
                return said.result
            elif said.task == task:
                running = True
            else:
                trouble = TaskLost(
                    f"task {task} is not known any more: another one has run since, or the service was started again"
                )
        now = time.monotonic()
        trouble_since = None if trouble is None else now if trouble_since is None else trouble_since
        if trouble is not None and trouble_since is not None and now - trouble_since >= grace_s:
            if result is not None:
                return as_status(task, result)
            raise trouble
        if now >= deadline:
            raise Timeout(f"task {task} has not ended within {timeout_s:g} s and goes on: wait again, or cancel it")
        told = _hear(stream, heard, min(LOOK_S, deadline - now))
        result = told if running and result is None else result  # one task runs at a time, so it is this one's


def wait_until_settled(goal_deg: Sequence[float], ask: Callable[[], Status], timeout_s: float, grace_s: float) -> None:
    """Until the joints stand still at `goal_deg`.

    Raises Timeout; RigError for a fault, and when the joints have stood still elsewhere for `grace_s`.
    """
    deadline = time.monotonic() + timeout_s
    still_since: float | None = None
    while True:
        rig = ask().rig
        if rig is None:
            raise NoAnswer("the rig went away during the move: only the engine answers")
        motion = rig.motion
        if motion.fault:
            raise RigError(f"the move failed: {motion.fault}")
        now = time.monotonic()
        still_since = None if motion.moving else now if still_since is None else still_since
        if not motion.moving and _is_at(goal_deg, motion):
            return
        if still_since is not None and now - still_since >= grace_s:
            where = ", ".join(f"{joint.position_deg:.1f}" for joint in motion.joints)
            goal = ", ".join(f"{angle:.1f}" for angle in goal_deg)
            raise RigError(f"the joints stand still at {where} deg instead of {goal} deg: the move was stopped")
        if now >= deadline:
            raise Timeout(f"the move has not settled within {timeout_s:g} s")
        time.sleep(min(0.1, deadline - now))


def _is_at(goal_deg: Sequence[float], motion: MotionStatus) -> bool:
    return len(goal_deg) == len(motion.joints) and all(
        abs(joint.position_deg - goal) <= SETTLED_DEG for joint, goal in zip(motion.joints, goal_deg, strict=True)
    )


def as_status(task: str, result: Result) -> ResultStatus:
    """The result of `task` as the status would tell it, except for the recording."""
    from viewsep.service.board import result_status  # with scipy, which is slow to import

    return result_status(task, result, None)


def _hear(stream: Stream, heard: Callable[[Received], None], timeout_s: float) -> Result | None:
    """Passes on what comes within `timeout_s`, or until a result has come: that one."""
    deadline = time.monotonic() + timeout_s
    while (received := stream.receive(max(0.0, deadline - time.monotonic()))) is not None:
        heard(received)
        if isinstance(received.message, Result):
            return received.message
    return None
