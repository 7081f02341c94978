"""What the service costs: a simulated rig is served in a process of its own and asked over 127.0.0.1."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import zenoh
from zenoh.handlers import Callback

from viewsep.client import Client, NoAnswer
from viewsep.errors import RigError
from viewsep.recordings.schemas.viewsep_pb2 import JointState
from viewsep.service.names import Keys, read_attachment
from viewsep.service.transport import client_session

NAME = "bench"
STARTS_S = 30.0
MOVES = 10
MOVE_DEG = 10.0
SLOW_VIEWER_S = 0.1  # what the slow viewer takes for a picture
CLOCK_SAMPLES = 30
Figures = Mapping[str, Mapping[str, float]]


def measure_service(seconds: float, seed: int, progress: Callable[[str], None] = lambda _what: None) -> Figures:
    """Milliseconds, 50th and 99th percentiles: every figure of pictures and status takes `seconds`.

    Raises RigError when the service does not start.
    """
    progress("starting a simulated rig")
    with _service(seed) as (endpoint, images), Client(NAME, connect=(endpoint,)) as client:
        figures = {}
        progress("status")
        figures["status round trip"] = _summary(_status_times(client, seconds))
        progress("status beside a slow viewer")
        with _viewer(images, lambda _sample: time.sleep(SLOW_VIEWER_S)):
            figures["status round trip, slow viewer"] = _summary(_status_times(client, seconds))
        progress("pictures")
        figures["exposure to viewer"] = _summary(_picture_times(client, images, seconds))
        progress("moves")
        figures["command to motion"] = _summary(_move_times(client, endpoint))
    return figures


@contextmanager
def _service(seed: int) -> Iterator[tuple[str, str]]:
    """A simulated rig in real time; its endpoints."""
    endpoint, images = (f"tcp/127.0.0.1:{port}" for port in _free_ports(2))
    with tempfile.TemporaryDirectory(prefix="viewsep-") as folder:
        config = Path(folder) / "service.toml"
        config.write_text(
            f'[service]\nname = "{NAME}"\nlisten = ["{endpoint}"]\nlisten_images = ["{images}"]\n'
            f"seed = {seed}\nlibrary = {json.dumps(folder)}\nrecordings = {json.dumps(folder)}\n",
            encoding="utf-8",
        )
        command = [sys.executable, "-m", "viewsep", "serve", "--config", str(config)]
        quiet = subprocess.DEVNULL
        process = subprocess.Popen(command, stdin=quiet, stdout=quiet, stderr=quiet)
        try:
            _wait_for(endpoint, process)
            yield endpoint, images
        finally:
            process.send_signal(signal.SIGTERM)
            process.wait()


def _wait_for(endpoint: str, process: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + STARTS_S
    while process.poll() is None and time.monotonic() < deadline:
        try:
            with Client(NAME, connect=(endpoint,)) as client:
                client.status()
                return
        except NoAnswer:
            time.sleep(0.1)
    raise RigError(f"the simulated rig was not served at {endpoint} within {STARTS_S:g} s")


def _status_times(client: Client, seconds: float) -> list[float]:
    times = []
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        begin = time.perf_counter()
        client.status()
        times.append(time.perf_counter() - begin)
        time.sleep(0.01)
    return times


def _picture_times(client: Client, endpoint: str, seconds: float) -> list[float]:
    """From the moment of exposure, on the rig's clock, until the compressed picture is here."""
    offset_ns = _clock_offset_ns(client)
    times: list[float] = []

    def arrived(sample: zenoh.Sample) -> None:
        now_ns = time.monotonic_ns()
        if sample.attachment is not None:
            _, stamp_ns = read_attachment(sample.attachment.to_bytes())
            times.append((now_ns + offset_ns - stamp_ns) * 1e-9)

    with _viewer(endpoint, arrived):
        time.sleep(seconds)
    return times


def _move_times(client: Client, endpoint: str) -> list[float]:
    """From sending the request until a read-back that says the joints move is here."""
    times: list[float] = []
    begin = [0.0]

    def arrived(sample: zenoh.Sample) -> None:
        if begin[0] and JointState.FromString(sample.payload.to_bytes()).moving:
            times.append(time.perf_counter() - begin[0])
            begin[0] = 0.0

    with _subscribed(endpoint, Keys(NAME).key("motion/state"), arrived):
        for number in range(MOVES):
            goal = [MOVE_DEG if number % 2 == 0 else 0.0] * len(_joints(client))
            begin[0] = time.perf_counter()
            client.settle(client.move(joints_deg=goal), timeout_s=30.0)
    return times


def _clock_offset_ns(client: Client) -> int:
    """The rig's clock minus ours, from the shortest of several round trips."""
    best, offset_ns = 1 << 62, 0
    for _ in range(CLOCK_SAMPLES):
        sent_ns = time.monotonic_ns()
        said = client.status().rig
        received_ns = time.monotonic_ns()
        if said is not None and received_ns - sent_ns < best:
            best = received_ns - sent_ns
            offset_ns = said.clock_ns - (sent_ns + received_ns) // 2
    return offset_ns


def _joints(client: Client) -> tuple[str, ...]:
    said = client.status().rig
    return tuple(joint.name for joint in said.motion.joints) if said else ()


@contextmanager
def _viewer(endpoint: str, heard: Callable[[zenoh.Sample], None]) -> Iterator[None]:
    with _subscribed(endpoint, Keys(NAME).image, heard):
        yield


@contextmanager
def _subscribed(endpoint: str, key: str, heard: Callable[[zenoh.Sample], None]) -> Iterator[None]:
    """Call `heard` with every sample on a session of its own, in the thread that reads the link: slow is slow."""
    with ExitStack() as stack:
        session = client_session((endpoint,), None, "", 5.0)
        stack.callback(session.close)
        subscriber = session.declare_subscriber(key, Callback(heard, indirect=False))
        stack.callback(subscriber.undeclare)
        yield


def _free_ports(count: int) -> list[int]:
    with ExitStack() as stack:
        probes = [stack.enter_context(socket.socket()) for _ in range(count)]
        for probe in probes:
            probe.bind(("127.0.0.1", 0))
        return [int(probe.getsockname()[1]) for probe in probes]


def _summary(times: list[float]) -> dict[str, float]:
    ms = 1e3 * np.array(times)
    return {
        "p50_ms": float(np.percentile(ms, 50)),
        "p99_ms": float(np.percentile(ms, 99)),
        "samples": float(len(ms)),
    }
