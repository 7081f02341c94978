"""The simulated rig's camera."""

from __future__ import annotations

import threading

import numpy as np

from viewsep.errors import NotConnected, Timeout
from viewsep.messages import Frame
from viewsep.sim.disturbances import constant_gains, disturbed
from viewsep.sim.render import Pictures
from viewsep.sim.world import MEMORY_S, Scene


class SimCamera:
    """`CameraSource` that exposes at a fixed rate and makes the picture when somebody reads the frame; any number may.

    Frames carry the moment of exposure and arrive `latency_s` later; dropped ones never do.
    """

    def __init__(self, scene: Scene, pictures: Pictures, rate_hz: float = 30.0, seed: int = 0) -> None:
        self._scene = scene
        self._pictures = pictures
        self._period_ns = round(1e9 / rate_hz)
        self._seed = seed
        self._rendering = threading.Lock()
        self._connected = False
        self._drops = 0
        self._first = self._last = 0

    def connect(self) -> None:
        """Open the scene."""
        self._scene.open()
        self._connected = True
        self._drops = 0
        self._first = self._last = self._scene.clock.now_ns() // self._period_ns

    def read(self, newer_than_ns: int, timeout_s: float) -> Frame:
        """The first exposure after `newer_than_ns` that is not lost; waits in simulated time."""
        if not self._connected:
            raise NotConnected("the simulated camera is not connected: call connect() first")
        d, clock = self._scene.disturbances, self._scene.clock
        deadline_ns = clock.now_ns() + round(timeout_s * 1e9)
        oldest_ns = max(newer_than_ns, clock.now_ns() - round(MEMORY_S * 0.9e9))
        sequence = max(oldest_ns // self._period_ns, self._first) + 1
        in_time = (deadline_ns - round(d.latency_s * 1e9)) // self._period_ns
        while sequence <= in_time and self._rng(sequence, 3).random() < d.drop_rate:
            sequence += 1
        stamp_ns = sequence * self._period_ns
        arrival_ns = stamp_ns + round(d.latency_s * 1e9)
        if arrival_ns > deadline_ns:
            clock.sleep_until(deadline_ns)
            raise Timeout(f"the simulated camera delivered no frame within {timeout_s:g} s")
        clock.sleep_until(arrival_ns)
        rotation = self._scene.object_rotation(stamp_ns)
        with clock.lock:
            self._count_drops(sequence)
        with self._rendering:
            image, mask = self._pictures.render(self._scene.geometry.camera_direction, rotation)
        image, mask = disturbed(image, mask, d, self._rng(sequence, 4), constant_gains(d, self._seed))
        return Frame(stamp_ns, sequence, image, mask)

    @property
    def drops(self) -> int:
        """Exposures that were lost between the frames read."""
        return self._drops

    def close(self) -> None:
        """Leave the pictures."""
        self._connected = False
        with self._rendering:
            self._pictures.close()

    def _count_drops(self, sequence: int) -> None:
        if self._scene.disturbances.drop_rate > 0:
            skipped = range(self._last + 1, sequence)
            self._drops += sum(self._rng(k, 3).random() < self._scene.disturbances.drop_rate for k in skipped)
        self._last = max(self._last, sequence)

    def _rng(self, sequence: int, stream: int) -> np.random.Generator:
        """Chance that depends on the exposure alone, not on which frames were read before."""
        return np.random.default_rng([self._seed, stream, sequence])
