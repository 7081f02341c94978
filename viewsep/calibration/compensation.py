"""A rig as it would be with exact stamps and without play: what perception looks through."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from viewsep.calibration.play import held_states
from viewsep.config import Config
from viewsep.interfaces import CameraSource, JointLimits, MotionBackend
from viewsep.messages import Frame, JointState
from viewsep.session import Rig

KEPT_NS = 20_000_000_000  # read-backs that are older are forgotten


def compensated(rig: Rig, config: Config) -> Rig:
    """The rig with what its calibration says taken out: the camera's latency and the joints' play; for looking only.

    Moves are still checked by the encoders, so sessions keep the rig itself.
    """
    play = config.rig.backlash_deg
    camera = PunctualCamera(rig.camera, config.camera.latency_s) if config.camera.latency_s else rig.camera
    motion = HeldMotion(rig.motion, np.radians(play).tolist()) if any(play) else rig.motion
    return replace(rig, camera=camera, motion=motion)


class PunctualCamera:
    """A camera whose frames carry the moment of exposure: their stamps less the camera's latency."""

    def __init__(self, camera: CameraSource, latency_s: float) -> None:
        self._camera = camera
        self._latency_ns = round(latency_s * 1e9)

    def connect(self) -> None:
        """Open the camera."""
        self._camera.connect()

    def read(self, newer_than_ns: int, timeout_s: float) -> Frame:
        """The first frame exposed after `newer_than_ns`. Raises Timeout."""
        frame = self._camera.read(newer_than_ns + self._latency_ns, timeout_s)
        return replace(frame, stamp_ns=frame.stamp_ns - self._latency_ns)

    @property
    def drops(self) -> int:
        """The camera's."""
        return self._camera.drops

    def close(self) -> None:
        """Release the camera."""
        self._camera.close()


class HeldMotion:
    """A motion backend whose history tells of the object, not the encoders: behind by half the play of each joint.

    Where the object is in the play at first is not known, and taken for the middle, until a joint has turned by all of
    it. For any number of threads.
    """

    def __init__(self, motion: MotionBackend, play_rad: Sequence[float]) -> None:
        self._motion = motion
        self._play_rad = tuple(play_rad)
        self._held: list[JointState] = []
        self._lock = threading.Lock()

    def history(self, since_ns: int) -> tuple[JointState, ...]:
        """Where the object was, from the last read-back at or before `since_ns` on."""
        with self._lock:
            last = self._held[-1] if self._held else None
            read = self._motion.history(last.stamp_ns if last else 0)
            new = [state for state in read if last is None or state.stamp_ns > last.stamp_ns]
            self._held += held_states(new, self._play_rad, last)
            if self._held and self._held[-1].stamp_ns - self._held[0].stamp_ns > 2 * KEPT_NS:
                oldest_ns = self._held[-1].stamp_ns - KEPT_NS
                self._held = [state for state in self._held if state.stamp_ns >= oldest_ns]
            before = sum(state.stamp_ns <= since_ns for state in self._held)
            return tuple(self._held[max(before - 1, 0) :])

    def connect(self) -> None:
        """Open the backend."""
        self._motion.connect()

    def limits(self) -> tuple[JointLimits, ...]:
        """The backend's."""
        return self._motion.limits()

    def move_to(self, position_rad: Sequence[float]) -> tuple[float, ...]:
        """Start moving; set-points are the encoders'."""
        return self._motion.move_to(position_rad)

    def read_state(self) -> JointState:
        """The newest read-back of the encoders."""
        return self._motion.read_state()

    def stop(self) -> None:
        """Stop the backend."""
        self._motion.stop()

    def fault(self) -> str:
        """The backend's."""
        return self._motion.fault()

    def clear_fault(self) -> None:
        """Clear the backend's."""
        self._motion.clear_fault()

    def temperatures_c(self) -> tuple[float | None, ...]:
        """The backend's."""
        return self._motion.temperatures_c()

    def counters(self) -> Mapping[str, int]:
        """The backend's."""
        return self._motion.counters()

    def close(self) -> None:
        """Stop and release the backend."""
        self._motion.close()
