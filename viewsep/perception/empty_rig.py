"""Taking pictures of the empty rig, joint angle by joint angle, to learn its background or its holder from."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from viewsep.messages import Array
from viewsep.moves import move_and_wait
from viewsep.session import SETTLED_RAD, Rig


def captured(
    rig: Rig, positions_rad: Sequence[Sequence[float]], frame_timeout_s: float = 1.0
) -> Iterator[tuple[Array, tuple[float, ...]]]:
    """Drive a connected rig to each of the positions (n,) and yield the picture taken there with the angles read back.

    Nothing may be in the holder. Raises MoveRefused, RigError with the fault that stopped a move, and Timeout when a
    move does not settle or no frame comes.
    """
    for position in positions_rad:
        move_and_wait(rig.motion, rig.clock, position, within_rad=SETTLED_RAD)
        frame = rig.camera.read(rig.clock.now_ns(), frame_timeout_s)
        yield frame.image, rig.motion.read_state().position_rad
