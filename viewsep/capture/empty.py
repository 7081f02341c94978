"""Learning the empty rig: which joints show, pictures at their angles, and what is made of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from viewsep.errors import try_all
from viewsep.messages import JointState
from viewsep.perception.empty_rig import EmptyPicture, captured, positions_for, shows, tried_positions
from viewsep.session import Rig

FRAME_TIMEOUT_S = 2.0


@dataclass(frozen=True, slots=True)
class EmptyRig:
    """Pictures of the empty rig at all angles of the `joints` (indices) that show in them; those of others are NaN."""

    pictures: list[EmptyPicture]
    joints: tuple[int, ...]


def capture_empty(
    rig: Rig,
    joints: Sequence[int] | None,
    every_rad: float,
    planned: Callable[[int], None] = lambda count: None,
    tick: Callable[[], None] = lambda: None,
    watch: Callable[[JointState], None] = lambda state: None,
) -> EmptyRig:
    """Open the rig, drive it through the angles of `joints` (None: those that are found to show), and close it.

    `planned` hears how many pictures there will be, `tick` of every one, `watch` every read-back, and stops all by
    raising. Raises RigError, BadInput.
    """
    limits, home = rig.motion.limits(), rig.geometry.home()
    try:
        rig.motion.connect()
        rig.camera.connect()
        if joints is None:
            joints = [joint for joint in range(len(limits)) if _shows(rig, joint, watch)]
        positions = positions_for(limits, home, joints, every_rad)
        planned(len(positions))
        pictures = []
        for image, angles in captured(rig, positions, FRAME_TIMEOUT_S, watch):
            shown = tuple(angle if joint in joints else np.nan for joint, angle in enumerate(angles))
            pictures.append((image, shown))
            tick()
    finally:
        try_all((rig.motion.close, rig.camera.close))
    return EmptyRig(pictures, tuple(joints))


def _shows(rig: Rig, joint: int, watch: Callable[[JointState], None]) -> bool:
    positions = tried_positions(rig.motion.limits(), rig.geometry.home(), joint)
    return shows(list(captured(rig, positions, FRAME_TIMEOUT_S, watch)))
