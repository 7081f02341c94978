"""A Dask cluster that somebody else has started: connect to it, and make sure it can do our work."""

from __future__ import annotations

import logging
import socket
from collections.abc import Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

from viewsep import __version__
from viewsep.errors import BadInput

if TYPE_CHECKING:
    from distributed import Client

DEADLINE_S = 10.0


class ClusterLost(Exception):
    """The scheduler went away in the middle, or worker after worker died of the same call."""


def check_address(address: str) -> None:
    """A scheduler's address is tcp://HOST:PORT. Raises BadInput."""
    try:
        parts = urlsplit(address)
        sound = parts.scheme == "tcp" and parts.hostname and parts.port and not (parts.path or parts.query)
    except ValueError:  # a port that is none
        sound = False
    if not sound:
        raise BadInput(f"--scheduler {address!r}: give the address as the scheduler prints it, tcp://HOST:PORT")


@contextmanager
def connected(address: str, deadline_s: float = DEADLINE_S) -> Iterator[Client]:
    """A client of the cluster; leaving takes back what is not finished.

    Raises BadInput when the extra is not installed, nobody answers within the deadline, or the workers cannot do it;
    ClusterLost when it goes away meanwhile.
    """
    check_address(address)
    try:
        from distributed import Client, KilledWorker
    except ImportError as error:
        raise BadInput("--scheduler needs the packages dask and distributed: pip install 'viewsep[cluster]'") from error
    if problem := _greeting_problem(address, deadline_s):
        raise BadInput(
            f"--scheduler {address}: no Dask scheduler answers there ({problem}); start one with 'dask scheduler', or "
            "check the address"
        )
    with _quiet(), Client(address, timeout=deadline_s, set_as_default=False) as client:
        _check_workers(client, address, deadline_s)
        try:
            yield client
        except (CancelledError, KilledWorker) as error:
            raise ClusterLost(f"the cluster {address} was lost") from error


@contextmanager
def _quiet() -> Iterator[None]:
    """Dask reports a lost connection with tracebacks; we say it in a sentence."""
    logger = logging.getLogger("distributed.client")
    before = logger.level
    logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        logger.setLevel(before)


def _greeting_problem(address: str, deadline_s: float) -> str:
    """Why it is no Dask server that listens there, else empty. Dask's own client would wait for ever on some others."""
    parts = urlsplit(address)
    try:
        with socket.create_connection((parts.hostname, parts.port), timeout=deadline_s) as connection:
            greeting = connection.recv(8, socket.MSG_WAITALL)
    except TimeoutError:
        return f"nothing heard within {deadline_s:g} s"
    except OSError as error:
        return error.strerror or str(error)
    # a Dask server speaks first, beginning with the length of what it says
    return "" if 0 < int.from_bytes(greeting, "little") < 1 << 20 else "something else does"


def _check_workers(client: Client, address: str, deadline_s: float) -> None:
    """Workers must be there, run one call at a time (pybullet is not made for threads) and have this viewsep."""
    start = f"dask worker {address} --nthreads 1"
    try:
        client.wait_for_workers(1, timeout=deadline_s)
    except TimeoutError as error:
        raise BadInput(f"the scheduler {address} has no workers: start some with '{start}'") from error
    threaded = {worker: count for worker, count in client.nthreads().items() if count > 1}
    for worker, count in threaded.items():
        raise BadInput(f"the worker {worker} runs {count} calls at a time, in threads: start it with '{start}'")
    try:
        versions = client.run(version, "viewsep")
    except ModuleNotFoundError as error:
        raise BadInput(f"a worker of {address} has no viewsep: install viewsep {__version__} there") from error
    for worker, other in versions.items():
        if other != __version__:
            raise BadInput(f"the worker {worker} has viewsep {other}: install viewsep {__version__} there")
