"""The role that thinks and records: tasks, their owners, models, recordings."""

from __future__ import annotations

import logging
import secrets
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from viewsep.assembly import check_descriptor
from viewsep.config import Config
from viewsep.interfaces import Listener
from viewsep.messages import Result
from viewsep.plugins import make_descriptor
from viewsep.service.answering import Answer
from viewsep.service.board import Board, candidate_status, result_status
from viewsep.service.catalogue import Catalogue
from viewsep.service.learner import Learner
from viewsep.service.presence import check_present
from viewsep.service.requests import (
    CancelRequest,
    Code,
    LearnRequest,
    RecordRequest,
    Refused,
    StartRequest,
    StopRequest,
    accepted,
    parse_request,
)
from viewsep.service.rig_access import RigAccess
from viewsep.service.status import EngineStatus, RecordingStatus, ResultStatus
from viewsep.service.task import RunningTask, TaskOrder

log = logging.getLogger("viewsep.service.engine")
CLOSING_S = 20.0


class EngineRole:
    """Carries out one task at a time. All public functions may be called from any thread."""

    def __init__(
        self,
        config: Config,
        access: RigAccess,
        listener: Listener,
        present: Callable[[str], bool],
        config_file: Path | None = None,
    ) -> None:
        self._config = config
        self._catalogue = Catalogue(Path(config.service.library))
        self._access = access
        self._present = present
        self._board = Board()
        self._listeners: Sequence[Listener] = (self._board, listener)
        self._lock = threading.RLock()
        self._task: RunningTask | None = None
        self._starting = ""
        self._stops = 0
        self._searches: list[threading.Thread] = []
        self._result: ResultStatus | None = None
        self._recording = RecordingStatus(enabled=config.service.record)
        self._faults: tuple[str, ...] = ()
        self._learner = Learner(self._catalogue.folder, config_file)
        self._closing = False
        self._since = time.monotonic()

    def answers(self) -> Mapping[str, Answer]:
        """The commands of this role."""
        return {"start": self.start, "cancel": self.cancel, "learn": self.learn, "record": self.record}

    def start(self, payload: bytes) -> bytes:
        """Begin a task. Raises Refused."""
        request = parse_request("start", payload)
        assert isinstance(request, StartRequest)
        check_present(request.token, self._present)
        with self._lock:
            self._check_free()
            self._starting = request.owner
        try:
            task = self._begin(request)
        finally:
            self._starting = ""
        record = task.order.record
        return accepted("start", task=task.order.name, recording=str(record) if record else None)

    def cancel(self, payload: bytes) -> bytes:
        """End the task of the one who asks. Raises Refused."""
        request = parse_request("cancel", payload)
        assert isinstance(request, CancelRequest)
        with self._lock:
            if self._task is None:
                raise Refused(Code.NO_TASK, "no task is running: there is nothing to cancel")
            owner = self._task.order.owner
            if owner != request.owner:
                raise Refused(
                    Code.NOT_OWNER,
                    f"the task belongs to {owner}, not to {request.owner}: only its owner may cancel it, "
                    "anybody who may command can stop it",
                )
            self._task.cancel(request.reason or f"by {owner}")
            return accepted("cancel", task=self._task.order.name)

    def stop(self, request: StopRequest) -> None:
        """End whatever runs, whoever started it."""
        with self._lock:
            self._stops += 1  # a task that is about to begin must not begin any more
            if self._task is not None:
                self._task.cancel(stopped_by(request))

    def learn(self, payload: bytes) -> bytes:
        """Learn a model in a process of its own. Raises Refused."""
        request = parse_request("learn", payload)
        assert isinstance(request, LearnRequest)
        with self._lock:
            self._check_open()
            self._learner.start(request)
        return accepted("learn", source=request.source)

    def record(self, payload: bytes) -> bytes:
        """Record the tasks from the next one on, or not."""
        request = parse_request("record", payload)
        assert isinstance(request, RecordRequest)
        with self._lock:
            self._recording = self._recording.model_copy(update={"enabled": request.enabled})
        return accepted("record", enabled=request.enabled, folder=self._config.service.recordings)

    def owner_gone(self, token: str) -> None:
        """The client whose token this was is not seen any more: its task ends, unless it is seen again at once."""
        with self._lock:
            task = self._task
            if task is None or not token or task.order.token != token or self._closing:
                return
            self._searches = [search for search in self._searches if search.is_alive()]
            self._searches.append(threading.Thread(target=self._search_owner, args=(task,), name="viewsep owner"))
            self._searches[-1].start()

    def status(self) -> EngineStatus:
        """The engine's section of the status."""
        with self._lock:
            phase, estimate = self._board.read()
            task = self._task
            return EngineStatus(
                phase=phase.value,
                task=task.order.name if task else "",
                owner=task.order.owner if task else "",
                seed=task.order.seed if task else None,
                candidates=tuple(candidate_status(c) for c in estimate.candidates) if estimate else (),
                unknown=estimate.unknown if estimate else None,
                looks=estimate.iteration if estimate else 0,
                travel_deg=float(np.degrees(estimate.travel_rad)) if estimate else 0.0,
                result=self._result,
                models=self._catalogue.digests(),
                learning=self._learner.under_way(),
                recording=self._recording_now(),
                link=self._access.link(),
                faults=(*self._faults, *self._catalogue.faults(), *self._learner.faults()),
                uptime_s=time.monotonic() - self._since,
            )

    def close(self) -> None:
        """End the task and everything else. Raises RuntimeError when the task does not end in time."""
        with self._lock:
            self._closing = True
            task = self._task
            if task is not None:
                task.cancel("the service is shutting down")
        self._learner.close()
        if task is not None and not task.join(CLOSING_S):
            raise RuntimeError(f"task {task.order.name} did not end within {CLOSING_S:g} s")
        for search in self._searches:
            search.join()

    def _search_owner(self, task: RunningTask) -> None:
        """Cancel a task whose owner stays away; while the rig is out of reach, owners behind it are not to be seen."""
        while self._task is task:
            in_reach = self._access.link().up
            if self._present(task.order.token):  # waits a moment
                return
            if in_reach and self._access.link().up:
                log.warning("the owner of %s has gone: holding position", task.order.name)
                task.cancel(f"its owner, {task.order.owner}, has gone")
                return

    def _check_open(self) -> None:
        if self._closing:
            raise Refused(Code.UNAVAILABLE, "the service is shutting down")

    def _check_free(self) -> None:
        self._check_open()
        if self._task is not None:
            order = self._task.order
            raise Refused(Code.BUSY, f"task {order.name} of {order.owner} is running: wait for it, or stop it")
        if self._starting:
            raise Refused(Code.BUSY, f"a task of {self._starting} is about to begin: wait for it, or stop it")

    def _begin(self, request: StartRequest) -> RunningTask:
        """Take the rig's lease and begin; gives it back when something is wrong. Raises Refused, RigError."""
        stops = self._stops
        models = self._catalogue.candidates(request.candidates)
        name = f"{self._config.service.name}-{datetime.now(UTC):%Y%m%d-%H%M%S}-{secrets.token_hex(2)}"
        config, held = self._access.setup(self._config)
        if request.pose_tolerance_deg is not None:
            asked = config.task.model_copy(update={"pose_tolerance_deg": request.pose_tolerance_deg})
            config = config.model_copy(update={"task": asked})
        truth = next((model.name for model in models if held and model.provenance.source == held), "")
        order = TaskOrder(name, request.owner, request.token, request.seed, truth, self._recording_file(name))
        check_descriptor(models, make_descriptor(config.descriptor))
        rig = self._access.lent_to(name)
        perception = self._access.perception(rig, config.descriptor)
        rig.motion.connect()
        try:
            fault = rig.motion.fault()
            if fault:
                raise Refused(Code.FAULT, f"{fault} (the request clear_fault tries to clear it)")
            rig.camera.connect()
            task = RunningTask(order, config, models, rig, perception, self._listeners, self._ended)
            with self._lock:
                self._check_open()
                if self._stops != stops:
                    raise Refused(Code.BUSY, "somebody stopped the rig while the task was about to begin: start again")
                task.start()  # when no thread can be had, there is no task
                self._task, self._faults = task, ()
        except BaseException:
            rig.motion.close()
            raise
        if request.token and not self._present(request.token):  # it went away while the task began
            self.owner_gone(request.token)
        log.info("task %s started by %s: %s", name, request.owner, ", ".join(model.name for model in models))
        return task

    def _recording_file(self, name: str) -> Path | None:
        """Where the recording of a task goes, None for none. Raises Refused."""
        if not self._recording.enabled:
            return None
        folder = Path(self._config.service.recordings)
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise Refused(Code.FAULT, f"{folder}: recordings cannot be kept there ({error.strerror})") from error
        return folder / f"{name}.mcap"

    def _ended(self, result: Result | None, error: Exception | None) -> None:
        """Called from the task's thread when everything of it is closed."""
        with self._lock:
            task = self._task
            assert task is not None
            order, recorder = task.order, task.recorder
            self._recording = self._recording_now().model_copy(update={"open": False})
            record = str(order.record) if order.record and order.record.exists() else None  # else it is a `.part`
            if result is not None:
                self._result = result_status(order.name, result, record)
            else:
                self._board.idle()
                self._result = ResultStatus(
                    task=order.name, outcome="failed", object=None, reason=str(error), recording=record
                )
            log.info("task %s: %s", order.name, self._result.account.sentence)
            if error is not None:
                self._faults = (f"task {order.name}: {error}",)
                log.error("task %s: %s", order.name, error)
            if recorder is not None and recorder.lost:
                why = recorder.error or "it could not keep up"
                missing = f"{order.record}: {recorder.lost} messages are missing from the recording: {why}"
                self._faults = (*self._faults, missing)
            self._task = None

    def _recording_now(self) -> RecordingStatus:
        task = self._task
        if task is None or task.order.record is None:
            return self._recording
        path, recorder = task.order.record, task.recorder
        return RecordingStatus(
            enabled=self._recording.enabled,
            file=str(path),
            bytes=_size(path),
            lost=recorder.lost if recorder else 0,
            open=True,
        )


def stopped_by(request: StopRequest) -> str:
    """Who stopped it and why."""
    return f"stopped by {request.owner}" + (f": {request.reason}" if request.reason else "")


def _size(path: Path) -> int:
    """Bytes of a recording that grows as `.part` and takes its name at the end."""
    for candidate in (path, path.with_name(path.name + ".part")):
        try:
            return candidate.stat().st_size
        except OSError:
            continue
    return 0
