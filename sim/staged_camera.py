"""A simulated camera with a real one's faults: no mask, wandering exposure, lost frames, old ones in a queue."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np

from viewsep.errors import NotConnected, Timeout
from viewsep.messages import Array, BoolArray, FloatArray, Frame
from viewsep.sim.followed import JointsAt
from viewsep.sim.render import Pictures
from viewsep.sim.stage import NEVER_S, Stage
from viewsep.sim.world import MEMORY_S, Scene

REMEMBERED_MASKS = 1000
EMPTY: tuple[Array, Array] = np.zeros((2, 2, 3), np.uint8), np.zeros((2, 2), bool)


@dataclass(frozen=True, slots=True)
class Delivery:
    """How frames come over: `latency_s` after their exposure, a `drop_rate` of them never.

    Up to `buffers` of those nobody reads wait in a queue, the oldest first, until somebody reads again; later ones are
    lost meanwhile. A driver with `discards` throws away what is older than what was asked for; without, it hands it on.
    From `stalled_s` to `goes_on_s` nothing is exposed.
    """

    rate_hz: float = 30.0
    latency_s: float = 0.03
    drop_rate: float = 0.0
    buffers: int = 4
    discards: bool = True
    stalled_s: float = NEVER_S
    goes_on_s: float = NEVER_S


class StagedCamera:
    """`CameraSource` that looks at the object of a scene on a stage; its frames have no mask.

    `pictures` None is the empty rig. `joints_at` tells the joint angles that plate and gripper show. What a frame looks
    like depends on the seed of the stage and on the exposure, not on which frames were read before.
    """

    def __init__(
        self,
        scene: Scene,
        pictures: Pictures | None,
        stage: Stage,
        joints_at: JointsAt,
        delivery: Delivery | None = None,
    ) -> None:
        self._scene = scene
        self._pictures = pictures
        self._stage = stage
        self._joints_at = joints_at
        self._delivery = delivery or Delivery()
        self._period_ns = round(1e9 / self._delivery.rate_hz)
        self._latency_ns = round(1e9 * self._delivery.latency_s)
        self._lock = threading.Lock()
        self._masks: OrderedDict[int, BoolArray] = OrderedDict()
        self._connected = False
        self._drops = 0
        self._queue: list[int] = []
        self._last = self._filled = 0  # exposures: handed on, and come to the queue

    def connect(self) -> None:
        """Open the scene and start to expose."""
        self._scene.open()
        self._connected = True
        self._drops = 0
        self._queue = []
        self._last = self._filled = self._scene.clock.now_ns() // self._period_ns

    def read(self, newer_than_ns: int, timeout_s: float) -> Frame:
        """The first exposure after `newer_than_ns` that is neither lost nor was crowded out of the queue."""
        if not self._connected:
            raise NotConnected("the staged camera is not connected: call connect() first")
        clock = self._scene.clock
        with self._lock:
            deadline_ns = clock.now_ns() + round(timeout_s * 1e9)
            sequence = self._next(newer_than_ns, clock.now_ns(), deadline_ns)
            stamp_ns = sequence * self._period_ns
            if stamp_ns + self._latency_ns > deadline_ns:
                clock.sleep_until(deadline_ns)
                raise Timeout(f"the staged camera delivered no frame within {timeout_s:g} s")
            clock.sleep_until(stamp_ns + self._latency_ns)
            self._drops += sum(self._lost(k) for k in range(self._last + 1, sequence))
            self._last, self._filled = sequence, max(self._filled, sequence)
            image, mask = self._exposed(stamp_ns, sequence)
            self._masks[stamp_ns] = mask
            if len(self._masks) > REMEMBERED_MASKS:
                self._masks.popitem(last=False)
        return Frame(stamp_ns, sequence, image, None)

    def true_mask(self, stamp_ns: int) -> BoolArray:
        """(H, W) where the object is seen in the frame of that time stamp, for tests. KeyError for one never read."""
        return self._masks[stamp_ns]

    @property
    def drops(self) -> int:
        """Exposures that were lost on the way between the frames read."""
        return self._drops

    def close(self) -> None:
        """Leave the pictures."""
        self._connected = False
        with self._lock:
            if self._pictures is not None:
                self._pictures.close()

    def _next(self, newer_than_ns: int, now_ns: int, deadline_ns: int) -> int:
        """The exposure that is handed on; one that arrives after the deadline where there is none before."""
        self._fill(now_ns)
        if self._delivery.discards:
            known_ns = max(newer_than_ns, now_ns - round(MEMORY_S * 0.9e9))  # what the scene remembers
            self._queue = [k for k in self._queue if k * self._period_ns > known_ns]
        if self._queue:
            return self._queue.pop(0)
        sequence = max(newer_than_ns // self._period_ns, self._filled) + 1
        while self._lost(sequence) and sequence * self._period_ns + self._latency_ns <= deadline_ns:
            sequence += 1
        return sequence

    def _fill(self, now_ns: int) -> None:
        """Let what has arrived wait in the queue until that is full; the rest is gone."""
        newest = (now_ns - self._latency_ns) // self._period_ns
        sequence = self._filled + 1
        while sequence <= newest and len(self._queue) < self._delivery.buffers:
            if not self._lost(sequence):
                self._queue.append(sequence)
            sequence += 1
        self._filled = max(self._filled, newest)

    def _exposed(self, stamp_ns: int, sequence: int) -> tuple[Array, BoolArray]:
        rotation: FloatArray = self._scene.object_rotation(stamp_ns)
        picture, mask = EMPTY
        if self._pictures is not None:
            picture, mask = self._pictures.render(self._scene.geometry.camera_direction, rotation)
        return self._stage.exposed(picture, mask, self._joints_at(stamp_ns), stamp_ns, sequence)

    def _lost(self, sequence: int) -> bool:
        if self._delivery.stalled_s <= sequence * self._period_ns * 1e-9 < self._delivery.goes_on_s:
            return True
        rng = np.random.default_rng([*self._stage.staging.chance, 26, sequence])
        return bool(rng.random() < self._delivery.drop_rate)
