"""What the engine role last heard of its task, as the status says it."""

from __future__ import annotations

import threading

import numpy as np

from viewsep.account import pose_spread_deg, telling_view_deg
from viewsep.geometry import matrix_to_quaternion
from viewsep.messages import CandidateEstimate, Estimate, FloatArray, Message, Phase, Result, TaskStarted
from viewsep.service.status import CandidateStatus, ResultStatus


class Board:
    """A `Listener` that keeps the newest estimate and result; read from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._phase = Phase.IDLE
        self._estimate: Estimate | None = None

    def hear(self, stamp_ns: int, message: Message) -> None:
        """Note estimates, and where the task begins and ends."""
        with self._lock:
            if isinstance(message, TaskStarted):
                self._phase, self._estimate = Phase.STARTING, None
            elif isinstance(message, Estimate):
                self._phase, self._estimate = message.phase, message
            elif isinstance(message, Result):
                self._phase = Phase.DONE

    def idle(self) -> None:
        """No task has been started, or one could not begin."""
        with self._lock:
            self._phase, self._estimate = Phase.IDLE, None

    def read(self) -> tuple[Phase, Estimate | None]:
        """Phase and newest estimate."""
        with self._lock:
            return self._phase, self._estimate


def candidate_status(candidate: CandidateEstimate) -> CandidateStatus:
    """A candidate in degrees, for people and programs."""
    spread = float(np.degrees(np.sqrt(candidate.variance)))
    return CandidateStatus(
        name=candidate.name,
        rating=candidate.rating,
        w0=candidate.w0,
        w1_deg=float(np.degrees(candidate.w1)),
        w2=candidate.w2,
        pose_quaternion_xyzw=_quaternion(candidate.rotation),
        spread_deg=spread if np.isfinite(spread) else None,
        converged=candidate.converged,
        probability=candidate.probability,
    )


def result_status(task: str, result: Result, recording: str | None) -> ResultStatus:
    """How the task `task` ended."""
    return ResultStatus(
        task=task,
        outcome=result.outcome.value,
        object=result.object or None,
        reason=result.reason,
        ratings=dict(result.ratings),
        pose_quaternion_xyzw=_quaternion(result.rotation),
        looks=result.looks,
        travel_deg=float(np.degrees(result.travel_rad)),
        recording=recording,
        indistinct=result.indistinct,
        telling_view_deg=telling_view_deg(result),
        pose_spread_deg=pose_spread_deg(result),
    )


def _quaternion(rotation: FloatArray) -> tuple[float, float, float, float]:
    x, y, z, w = (float(value) for value in matrix_to_quaternion(rotation))
    return x, y, z, w
