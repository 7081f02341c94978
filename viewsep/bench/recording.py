"""What recording costs: pictures and percepts at a steady rate through the recorder's thread to a real disk."""

from __future__ import annotations

import resource
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import cv2
import numpy as np

from viewsep.bench.memory import resident_mb
from viewsep.config import Config
from viewsep.geometry import spherical_direction
from viewsep.messages import Array, Frame, JointState, Message, Percept, PerceptReceived
from viewsep.plugins import make_descriptor
from viewsep.recording import in_background
from viewsep.recordings.container import CHUNK_BYTES
from viewsep.recordings.writer import Recorder

STATES_PER_FRAME = 2
PICTURES = 8  # different ones, in turns: making them must not cost what is measured


@dataclass(frozen=True, slots=True)
class RecordingFigures:
    """`cpu_share` is of one core, of the whole process; `cpu_share_idle` the same without a recorder.

    `rss_mb` is the resident memory once a second, `fullest` how many messages have waited at most, `late_ms` by how
    much the slowest call of the one who talks to the recorder took.
    """

    seconds: float
    frames: int
    messages: int
    lost: int
    fullest: int
    file_mb: float
    mb_per_s: float
    cpu_share: float
    cpu_share_idle: float
    late_ms: float
    rss_mb: tuple[float, ...]
    chunk_kb: float

    @property
    def rss_spread_mb(self) -> float:
        """How much the memory changed after the first tenth."""
        settled = self.rss_mb[len(self.rss_mb) // 10 :]
        return max(settled) - min(settled)


def measure_recording(
    folder: Path,
    seconds: float,
    rate_hz: float,
    size_px: tuple[int, int],
    seed: int,
    on_second: Callable[[], None] = lambda: None,
) -> RecordingFigures:
    """Record for a while into `folder`, which is emptied of it afterwards. Pictures are (height, width).

    Raises BadInput when it cannot be written there.
    """
    pictures = _pictures(size_px, seed)
    idle = _talk(lambda _stamp, _message: None, pictures, min(seconds, 3.0), rate_hz, lambda: None)
    path = folder / "bench.mcap"
    config = Config()
    recorder = Recorder(path, {}, settings=config.recording, overwrite=True)
    failed: list[Exception] = []
    try:
        with in_background(recorder, config, failed.append) as queued:
            talked = _talk(queued.hear, pictures, seconds, rate_hz, on_second)
        if failed:
            raise failed[0]
        file_mb = path.stat().st_size / 1e6
    finally:
        path.unlink(missing_ok=True)
    return RecordingFigures(
        seconds=talked.seconds,
        frames=talked.frames,
        messages=talked.messages,
        lost=queued.lost,
        fullest=queued.fullest,
        file_mb=file_mb,
        mb_per_s=file_mb / talked.seconds,
        cpu_share=talked.cpu_share,
        cpu_share_idle=idle.cpu_share,
        late_ms=talked.slowest_s * 1e3,
        rss_mb=tuple(talked.rss_mb),
        chunk_kb=CHUNK_BYTES / 1024,
    )


@dataclass
class _Talked:
    seconds: float
    frames: int
    messages: int
    cpu_share: float
    slowest_s: float
    rss_mb: list[float]


def _talk(
    hear: Callable[[int, Message], None],
    pictures: list[Array],
    seconds: float,
    rate_hz: float,
    on_second: Callable[[], None],
) -> _Talked:
    """Tell frames, percepts and read-backs at the rate, on time."""
    begun, cpu = time.monotonic(), _cpu_s()
    slowest, messages, rss = 0.0, 0, [resident_mb()]
    frames = round(seconds * rate_hz)
    for number in range(frames):
        time.sleep(max(0.0, begun + number / rate_hz - time.monotonic()))
        for message in _at(number, rate_hz, pictures):
            before = time.monotonic()
            hear(message.stamp_ns, message)
            slowest = max(slowest, time.monotonic() - before)
            messages += 1
        if number % round(rate_hz) == 0:
            rss.append(resident_mb())
            on_second()
    took = time.monotonic() - begun
    return _Talked(took, frames, messages, (_cpu_s() - cpu) / took, slowest, rss)


def _at(number: int, rate_hz: float, pictures: list[Array]) -> Iterator[Frame | JointState | PerceptReceived]:
    """What a rig tells around one exposure."""
    stamp_ns = round((number + 1) / rate_hz * 1e9)
    angle = 0.01 * number
    for part in range(STATES_PER_FRAME):
        yield JointState(stamp_ns + part * 1000, (angle, 0.0), (angle, 0.0), True)
    yield Frame(stamp_ns, number, pictures[number % len(pictures)], None)
    name, feature = _feature()
    yield PerceptReceived(Percept(stamp_ns, number, name, feature, spherical_direction(angle, 0.2)))


@cache
def _feature() -> tuple[str, Array]:
    """The default descriptor's name and a feature as large as its own."""
    descriptor = make_descriptor(Config().descriptor)
    return descriptor.name, np.full(descriptor.size, 1.0 / descriptor.size, np.float32)


def _pictures(size_px: tuple[int, int], seed: int) -> list[Array]:
    """Pictures about as hard to compress as those of a camera: smooth shapes with fine noise."""
    rng = np.random.default_rng(seed)
    height, width = size_px
    found = []
    for _ in range(PICTURES):
        coarse = rng.integers(0, 256, (height // 32, width // 32, 3)).astype(np.float32)
        smooth = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_CUBIC)
        found.append(np.clip(smooth + rng.normal(0.0, 2.0, smooth.shape), 0, 255).astype(np.uint8))
    return found


def _cpu_s() -> float:
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime
