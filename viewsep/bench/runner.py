"""Many independent calls, in local processes or on a Dask cluster: always the same rows, and nothing done twice."""

from __future__ import annotations

import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from typing import Any

import cv2
import joblib
from joblib.externals.loky.backend import resource_tracker as joblib_tracker
from threadpoolctl import threadpool_limits

from viewsep.bench.cluster import ClusterLost, check_address, connected
from viewsep.bench.journal import Journal, Row
from viewsep.errors import BadInput, Interrupted, ViewsepError

STOPPING = (signal.SIGINT, signal.SIGTERM)
PARENT_CHECK_S = 1.0
CLEARED_QUIETLY = "ignore:resource_tracker"  # trackers clear away what a stopped run leaves; nobody needs to be told

Outcome = tuple[str, str | ViewsepError]
"""A call's key and its row as JSON, or the error."""


@dataclass(frozen=True, eq=False)
class Call:
    """One piece of work: a function of a module, its arguments, and a key that names the row within the experiment."""

    key: str
    function: Callable[..., Row]
    arguments: tuple[Any, ...] = ()


@dataclass(frozen=True, slots=True)
class Workers:
    """Who does the work: `jobs` local processes (-1: one per core), or the workers of a Dask `scheduler`.

    Raises BadInput for a number of jobs or an address that makes no sense.
    """

    jobs: int = -1
    scheduler: str = ""

    def __post_init__(self) -> None:
        if self.jobs == 0 or self.jobs < -1:
            raise BadInput(f"--jobs {self.jobs}: give a number of processes, or -1 for one per core")
        if self.scheduler:
            check_address(self.scheduler)
            if self.jobs != -1:
                raise BadInput(f"--jobs {self.jobs} counts local processes: leave it out with --scheduler")


def run_calls(
    calls: Sequence[Call],
    workers: Workers | None = None,
    journal: Journal | None = None,
    on_row: Callable[[Row], None] = lambda _row: None,
) -> list[Row]:
    """The calls' rows in the order of the calls. Rows the journal has are taken from there, new ones go into it.

    Rows do not depend on the workers: a call has one thread and what it returns goes through JSON. `on_row` hears of
    every row, those of the journal first. The first ViewsepError of a call ends the run with that error, Ctrl-C and
    SIGTERM end it with Interrupted; finished rows stay in the journal.
    """
    rows = {call.key: journal.rows[call.key] for call in calls if journal and call.key in journal.rows}
    for row in rows.values():
        on_row(row)
    wanted = [call for call in calls if call.key not in rows]
    if len({call.key for call in wanted}) + len(rows) != len(calls):
        raise ValueError("two calls have the same key")

    def keep(key: str, row: Row) -> None:
        if journal:
            journal.append(key, row)
        rows[key] = row
        on_row(row)

    with _stoppable() as stop:
        try:
            _work_off(wanted, workers or Workers(), keep, stop)
        except (KeyboardInterrupt, BrokenProcessPool, ClusterLost) as error:
            kept = "nothing of it is kept"
            if journal:
                kept = f"{len(rows)} of {len(calls)} tasks are kept in {journal.path}: go on with --resume"
            if stop.heard or isinstance(error, KeyboardInterrupt):
                raise Interrupted(f"interrupted; {kept}") from None
            if isinstance(error, ClusterLost):
                raise ViewsepError(f"{error}; {kept}") from error
            raise ViewsepError(
                f"a worker process died, perhaps for want of memory (fewer --jobs help); {kept}"
            ) from error
    return [rows[call.key] for call in calls]


class _Stop:
    """Ends the run at the first signal, but not while a row is being kept. A second one does not disturb the cleaning
    up, as terminals and supervisors like to send two; a third one ends that too.
    """

    def __init__(self) -> None:
        self.heard = 0
        self._keeping = False

    def __call__(self, _number: int, _frame: object) -> None:
        self.heard += 1
        if (self.heard == 1 and not self._keeping) or self.heard > 2:
            raise KeyboardInterrupt

    @contextmanager
    def not_now(self) -> Iterator[None]:
        """A signal that comes in here is obeyed at the end."""
        self._keeping = True
        try:
            yield
        finally:
            self._keeping = False
        if self.heard:
            raise KeyboardInterrupt


@contextmanager
def _stoppable() -> Iterator[_Stop]:
    """Ctrl-C and SIGTERM raise KeyboardInterrupt at sensible moments."""
    stop = _Stop()
    if threading.current_thread() is not threading.main_thread():  # the only one that hears signals
        yield stop
        return
    before = [signal.signal(number, stop) for number in STOPPING]
    try:
        yield stop
    finally:
        for number, handler in zip(STOPPING, before, strict=True):
            signal.signal(number, handler)


def _work_off(calls: list[Call], workers: Workers, keep: Callable[[str, Row], None], stop: _Stop) -> None:
    """Give all calls to the workers and keep the rows as they come. Whatever goes wrong ends the workers at once."""
    with _backend(workers):
        parallel = joblib.Parallel(return_as="generator_unordered", batch_size=1, max_nbytes=None)
        with _deaf_children():
            outcomes = parallel(joblib.delayed(_outcome)(call.key, call.function, *call.arguments) for call in calls)
        try:
            for key, outcome in outcomes:
                if isinstance(outcome, ViewsepError):
                    raise outcome
                with stop.not_now():
                    keep(key, json.loads(outcome))
        except BaseException as error:
            outcomes.throw(error)  # makes joblib end the workers; closing would only warn about them


@contextmanager
def _backend(workers: Workers) -> Iterator[None]:
    """What joblib works with."""
    if workers.scheduler:
        with connected(workers.scheduler) as client, joblib.parallel_config(backend="dask", n_jobs=-1, client=client):
            yield
    else:
        begin = {"initializer": _end_with, "initargs": (os.getpid(),)}
        with joblib.parallel_config(backend="loky", n_jobs=workers.jobs, **begin):
            yield


@contextmanager
def _deaf_children() -> Iterator[None]:
    """Processes started in here never hear the Ctrl-C that the terminal sends to all; this one hears it afterwards."""
    sys.warnoptions.append(CLEARED_QUIETLY)
    try:
        for tracker in (resource_tracker, joblib_tracker):  # they would be started in between, and end the deafness
            tracker.ensure_running()
    finally:
        sys.warnoptions.remove(CLEARED_QUIETLY)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end_with(parent: int) -> None:
    """Set a worker process up to end when its parent is gone, even if that was killed."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_CHECK_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _outcome(key: str, function: Callable[..., Row], *arguments: Any) -> Outcome:
    """Carry out a call, in whatever process. Deliberate errors come back as values: joblib would add tracebacks."""
    try:
        with one_thread():
            return key, json.dumps(function(*arguments))
    except ViewsepError as error:
        return key, error.with_traceback(None)


@contextmanager
def one_thread() -> Iterator[None]:
    """Sums that several threads share are rounded in another order, and processes that share a core only wait."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        with threadpool_limits(limits=1):
            yield
    finally:
        cv2.setNumThreads(before)
