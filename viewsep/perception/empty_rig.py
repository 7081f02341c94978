"""Taking pictures of the empty rig, joint angle by joint angle, to learn its background or its holder from."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import product

import numpy as np

from viewsep.errors import BadInput
from viewsep.interfaces import JointLimits
from viewsep.messages import Array, FloatArray, JointState
from viewsep.moves import move_and_wait
from viewsep.perception.background import changed_shares
from viewsep.session import SETTLED_RAD, Rig

STILL = 4  # pictures where nothing turns that is seen
MOST = 720  # pictures, which have to be in memory together
LEAST_SHARE, TIMES = 5e-4, 3.0  # of the picture, beside that by which pictures of the same position differ
TRIED_RAD = tuple(np.radians((25.0, 50.0, 75.0)))  # from home, to see whether a joint shows

EmptyPicture = tuple[Array, tuple[float, ...]]
"""A picture (H, W, 3) uint8 of the empty rig, and the joint angles (n,) that were read back."""


def captured(
    rig: Rig,
    positions_rad: Sequence[Sequence[float]],
    frame_timeout_s: float = 1.0,
    watch: Callable[[JointState], None] = lambda state: None,
) -> Iterator[EmptyPicture]:
    """Drive a connected rig to each of the positions (n,) and yield the picture taken there with the angles read back.

    Nothing may be in the holder. `watch` hears every read-back and stops all by raising. Raises MoveRefused, RigError
    with the fault that stopped a move, and Timeout when a move does not settle or no frame comes.
    """
    for position in positions_rad:
        move_and_wait(rig.motion, rig.clock, position, watch, SETTLED_RAD)
        frame = rig.camera.read(rig.clock.now_ns(), frame_timeout_s)
        yield frame.image, rig.motion.history(frame.stamp_ns)[0].position_rad


def tried_positions(limits: Sequence[JointLimits], home: Sequence[float], joint: int) -> list[tuple[float, ...]]:
    """Positions (n,) with one joint away from home and back in turns, so that light that drifts shows in both."""
    limit = limits[joint]
    way = 1.0 if limit.upper_rad - home[joint] >= home[joint] - limit.lower_rad else -1.0
    angles = [float(np.clip(home[joint] + way * by, limit.lower_rad, limit.upper_rad)) for by in TRIED_RAD]
    away = [(*home[:joint], angle, *home[joint + 1 :]) for angle in angles]
    return [position for there in away for position in (tuple(home), there)] + [tuple(home)]


def shows(pictures: Sequence[EmptyPicture]) -> bool:
    """Whether pictures of `tried_positions` differ by more than a camera that shakes explains."""
    shares = changed_shares([image for image, _ in pictures])
    away, home = shares[::2], shares[1::2]
    return max(away) > TIMES * max(home) + LEAST_SHARE


def positions_for(
    limits: Sequence[JointLimits], home: Sequence[float], joints: Sequence[int], every_rad: float
) -> list[tuple[float, ...]]:
    """Positions (n,) at which the empty rig is captured: all angles of `joints`, at most `every_rad` apart.

    Without any, a few times home. Raises BadInput where they would be too many.
    """
    if not joints:
        return [tuple(home)] * STILL
    grid = [_angles(limits[joint], home[joint], every_rad) for joint in joints]
    count = int(np.prod([len(angles) for angles in grid]))
    if count > MOST:
        names = " and ".join(limits[joint].name for joint in joints)
        raise BadInput(
            f"{names} show in the picture: capturing them every {np.degrees(every_rad):g} deg takes {count} pictures "
            f"(at most {MOST}); capture further apart, cover what turns, or use a plain backdrop"
        )
    positions = []
    for number, angles in enumerate(product(*grid[:-1])):
        last = grid[-1][:: 1 if number % 2 == 0 else -1]  # to and fro
        for angle in last:
            position = list(home)
            for joint, at in zip(joints, (*angles, angle), strict=True):
                position[joint] = float(at)
            positions.append(tuple(position))
    return positions


def _angles(limit: JointLimits, home_rad: float, every_rad: float) -> FloatArray:
    """Angles of a joint: once around, or from limit to limit."""
    span = limit.upper_rad - limit.lower_rad
    if span >= 2.0 * np.pi:
        steps = int(np.ceil(2.0 * np.pi / every_rad - 1e-9))
        start = home_rad if np.isinf(span) else limit.lower_rad
        return np.asarray(start + np.arange(steps) * 2.0 * np.pi / steps)
    return np.linspace(limit.lower_rad, limit.upper_rad, int(np.ceil(span / every_rad - 1e-9)) + 1)
