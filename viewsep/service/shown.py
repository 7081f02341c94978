"""What a recording that is played has shown so far, as a live rig and engine would say it."""

from __future__ import annotations

import json
import threading
import time
from collections import deque
from pathlib import Path

import numpy as np

from viewsep.config import Config, geometry_of, parse_config
from viewsep.errors import BadConfig
from viewsep.messages import JointState, Result, TaskStarted
from viewsep.recordings.codec import RecordedFrame
from viewsep.recordings.pacing import Item, Playback
from viewsep.recordings.reader import Recording
from viewsep.service.board import Board, candidate_status, result_status
from viewsep.service.status import (
    CameraStatus,
    EngineStatus,
    JointStatus,
    LinkStatus,
    MotionStatus,
    RecordingStatus,
    ReplayStatus,
    ResultStatus,
    RigStatus,
)

RATE_WINDOW_NS = 2_000_000_000
OWNER = "replay"


def recorded_config(recording: Recording) -> Config | None:
    """The configuration in a recording; None where there is none that this viewsep reads: it can be shown without."""
    try:
        return parse_config(json.loads(recording.metadata["config"]["json"]), "the recorded configuration")
    except (KeyError, ValueError, BadConfig):
        return None


class Shown:
    """The sections of the status, from what was played. Public functions may be called from any thread.

    Every time a recording is played is a task of its own, called like the file; the second one is FILE-2.
    """

    def __init__(self, recording: Recording, file: Path, playback: Playback) -> None:
        config, told = recorded_config(recording), recording.metadata.get("task", {})
        self._names = tuple(limit.name for limit in geometry_of(config.rig).limits) if config else ()
        self._models = dict(recording.metadata.get("models", {}))
        self._holds = told.get("truth", "")
        self._seed = int(told["seed"]) if told.get("seed", "").isdecimal() else None
        self._has_pictures = bool(recording.frames)
        gaps = len(recording.gaps)
        self._faults = (f"messages are missing at {gaps} place{'s' * (gaps > 1)} of {file}",) if gaps else ()
        self._file = file
        self._playback = playback
        self._lock = threading.RLock()
        self._board = Board()
        self._tasks = 0
        self._task = ""
        self._heard: Result | None = None
        self._result: ResultStatus | None = None
        self._joints: JointState | None = None
        self._pictures_ns: deque[int] = deque()
        self._since = time.monotonic()

    @property
    def task(self) -> str:
        """The name of the task that is shown, empty between two."""
        return self._task

    def begin(self) -> None:
        """A task begins; without effect where it has begun."""
        with self._lock:
            if not self._task:
                self._tasks += 1
                self._task = self._file.stem + (f"-{self._tasks}" if self._tasks > 1 else "")
                self._heard = None
                self._pictures_ns.clear()
                self._board.idle()

    def hear(self, item: Item) -> None:
        """Something was played."""
        with self._lock:
            if isinstance(item, RecordedFrame):
                self._pictures_ns.append(item.stamp_ns)
                while self._pictures_ns[0] < item.stamp_ns - RATE_WINDOW_NS:
                    self._pictures_ns.popleft()
                return
            message = item.message
            if isinstance(message, TaskStarted) and self._heard is not None:  # the next one in the same file
                self.end()
                self.begin()
            if isinstance(message, JointState):
                self._joints = message
            elif isinstance(message, Result):
                self._heard = message
            self._board.hear(item.stamp_ns, message)

    def end(self) -> ResultStatus:
        """The task has ended, with the result that was heard; how, as the status says it from now on."""
        with self._lock:
            task, self._task = self._task, ""
            if self._heard is not None:
                self._result = result_status(task, self._heard, str(self._file))
            else:
                why = "the recording ends before the task does"
                file = str(self._file)
                self._result = ResultStatus(task=task, outcome="failed", object=None, reason=why, recording=file)
            return self._result

    def replay(self) -> ReplayStatus:
        """What is played, and where it is."""
        playback = self._playback
        return ReplayStatus(
            file=str(self._file), pace=playback.pace, position_s=playback.position_s, duration_s=playback.duration_s
        )

    def rig(self, connections: tuple[str, ...]) -> RigStatus:
        """The rig's section, from read-backs and pictures; its clock is that of the recording."""
        with self._lock:
            motion = self._motion()
            return RigStatus(
                simulated=True,
                clock_ns=self._playback.stamp_ns,
                speed=self._playback.pace,
                holds=self._holds,
                motion=motion,
                camera=self._camera(),
                faults=(motion.fault,) if motion.fault else (),
                connections=connections,
                uptime_s=time.monotonic() - self._since,
            )

    def engine(self) -> EngineStatus:
        """The engine's section, from estimates and results."""
        with self._lock:
            phase, estimate = self._board.read()
            return EngineStatus(
                phase=phase.value,
                task=self._task,
                owner=OWNER if self._task else "",
                seed=self._seed if self._task else None,
                candidates=tuple(candidate_status(c) for c in estimate.candidates) if estimate else (),
                unknown=estimate.unknown if estimate else None,
                looks=estimate.iteration if estimate else 0,
                travel_deg=float(np.degrees(estimate.travel_rad)) if estimate else 0.0,
                result=self._result,
                models=self._models,
                recording=RecordingStatus(enabled=False),
                link=LinkStatus(up=True, local=True),
                faults=self._faults,
                uptime_s=time.monotonic() - self._since,
            )

    def _motion(self) -> MotionStatus:
        state = self._joints
        if state is None:
            return MotionStatus()
        count = len(state.position_rad)
        names = self._names if len(self._names) == count else tuple(f"joint {n + 1}" for n in range(count))
        joints = tuple(
            JointStatus(name=name, position_deg=float(np.degrees(position)), setpoint_deg=float(np.degrees(setpoint)))
            for name, position, setpoint in zip(names, state.position_rad, state.setpoint_rad, strict=False)
        )
        return MotionStatus(connected=True, joints=joints, moving=state.moving, fault=state.fault)

    def _camera(self) -> CameraStatus:
        now_ns = self._playback.stamp_ns
        recent = sum(stamp_ns > now_ns - RATE_WINDOW_NS for stamp_ns in self._pictures_ns)
        window_s = min(RATE_WINDOW_NS * 1e-9, self._playback.position_s)
        newest_ns = self._pictures_ns[-1] if self._pictures_ns else None
        return CameraStatus(
            connected=self._has_pictures,
            rate_hz=recent / window_s if window_s > 0.0 else 0.0,
            newest_age_s=None if newest_ns is None else max(0, now_ns - newest_ns) * 1e-9,
        )
