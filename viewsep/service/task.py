"""One task of a service: a session in a thread, heard by status, streams and recorder."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path

from viewsep.assembly import make_engine
from viewsep.config import Config
from viewsep.errors import ViewsepError
from viewsep.interfaces import Listener, Perception
from viewsep.messages import Result
from viewsep.models.aspect_graph import AspectGraph
from viewsep.recording import in_background, task_recorder
from viewsep.recordings.queue import QueuedListener
from viewsep.rigs import pace_of
from viewsep.session import Rig, Session

log = logging.getLogger("viewsep.service.engine")


@dataclass(frozen=True, slots=True)
class TaskOrder:
    """What was asked for. `record` is where the recording goes, None for none; `truth` is empty where not known."""

    name: str
    owner: str
    token: str
    seed: int
    truth: str
    record: Path | None


class RunningTask:
    """A task under way, on a rig whose lease it holds and gives back at the end.

    `on_end(result, error)` is called from its thread when everything of it is closed; either may be None.
    """

    def __init__(
        self,
        order: TaskOrder,
        config: Config,
        models: Sequence[AspectGraph],
        rig: Rig,
        perception: Perception,
        listeners: Sequence[Listener],
        on_end: Callable[[Result | None, Exception | None], None],
    ) -> None:
        self.order = order
        self.recorder: QueuedListener | None = None
        self._config = config
        self._models = models
        self._rig = rig
        self._perception = perception
        self._listeners = tuple(listeners)
        self._on_end = on_end
        self._lock = threading.Lock()
        self._cancelled = ""
        self._session: Session | None = None
        self._thread = threading.Thread(target=self._run, name="viewsep task")

    def start(self) -> None:
        """Begin."""
        self._thread.start()

    def cancel(self, reason: str) -> None:
        """Ask it to end; returns at once."""
        with self._lock:
            self._cancelled = reason
            if self._session is not None:
                self._session.cancel(reason)

    def join(self, timeout_s: float) -> bool:
        """Wait until it has ended; whether it has."""
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        result: Result | None = None
        failed: Exception | None = None
        try:
            with ExitStack() as stack:
                stack.callback(self._rig.camera.close)
                stack.callback(self._rig.motion.close)
                listeners = self._listeners
                if self.order.record is not None:
                    self.recorder = stack.enter_context(self._recording(self.order.record))
                    listeners = (*listeners, self.recorder)
                    stack.callback(self._rig.motion.close)  # at once, as completing the recording takes a while
                result = self._make_session(listeners).run(self.order.seed)
        except Exception as error:
            failed = error
            if not isinstance(error, ViewsepError):
                log.error("task %s ended by a bug", self.order.name, exc_info=error)
                failed = ViewsepError(f"ended by a bug, {type(error).__name__}: {error}; the log says more")
        self._on_end(result, failed)

    def _make_session(self, listeners: Sequence[Listener]) -> Session:
        """The session; making engine and plans takes a while, so it is done in the task's thread."""
        engine = make_engine(self._config, self._models)
        with self._lock:
            self._session = Session(self._rig, engine, self._perception, pace_of(self._config), listeners)
            if self._cancelled:
                self._session.cancel(self._cancelled)
            return self._session

    def _recording(self, path: Path) -> AbstractContextManager[QueuedListener]:
        """Record, in a thread of its own; a recording that fails ends the task."""
        recorder = task_recorder(path, self._config, self._models, self.order.seed, self.order.truth)
        return in_background(recorder, self._config, self._recording_failed)

    def _recording_failed(self, error: Exception) -> None:
        log.error("the recording has ended: %s", error)
        self.cancel(f"the recording cannot go on: {error}")
