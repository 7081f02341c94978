"""Taking pictures of the empty rig, joint angle by joint angle, to learn its background or its holder from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from viewsep.errors import Timeout
from viewsep.messages import Array
from viewsep.session import SETTLED_RAD, Rig

POLL_NS = 10_000_000


def captured(
    rig: Rig, positions_rad: Sequence[Sequence[float]], move_timeout_s: float = 15.0, frame_timeout_s: float = 1.0
) -> Iterator[tuple[Array, tuple[float, ...]]]:
    """Drive a connected rig to each of the positions (n,) and yield the picture taken there with the angles read back.

    Nothing may be in the holder. Raises MoveRefused, and Timeout when a move does not settle or no frame comes.
    """
    for position in positions_rad:
        commanded = rig.motion.move_to(position)
        deadline_ns = rig.clock.now_ns() + round(move_timeout_s * 1e9)
        state = rig.motion.read_state()
        while state.moving or np.max(np.abs(np.subtract(state.position_rad, commanded))) > SETTLED_RAD:
            if rig.clock.now_ns() > deadline_ns:
                raise Timeout(
                    f"the joints did not arrive at {np.degrees(commanded).round(1)} deg: {state.fault or 'slow'}"
                )
            rig.clock.sleep_until(rig.clock.now_ns() + POLL_NS)
            state = rig.motion.read_state()
        frame = rig.camera.read(rig.clock.now_ns(), frame_timeout_s)
        yield frame.image, rig.motion.read_state().position_rad
