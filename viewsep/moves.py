"""Moving a rig's joints and waiting until they have come to rest."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from viewsep.errors import RigError, Timeout
from viewsep.interfaces import Clock, MotionBackend
from viewsep.messages import JointState

POLL_NS = 20_000_000
LONGEST_S = 120.0  # backends have deadlines of their own, which know the way


def move_and_wait(
    motion: MotionBackend,
    clock: Clock,
    goal: Sequence[float],
    watch: Callable[[JointState], None] = lambda state: None,
    within_rad: float = np.inf,
) -> tuple[tuple[float, ...], JointState]:
    """Move to `goal` and wait until nothing moves and all joints are `within_rad` of their set-points.

    Returns what was commanded and the read-back at rest. `watch` hears every read-back, and stops the waiting by
    raising. Raises RigError with the backend's fault, Timeout.
    """
    commanded = motion.move_to(goal)
    until_ns = clock.now_ns() + round(LONGEST_S * 1e9)
    while True:
        state = motion.read_state()
        watch(state)
        if fault := motion.fault():
            raise RigError(fault)
        if not state.moving and np.abs(np.subtract(state.position_rad, commanded)).max() <= within_rad:
            return commanded, state
        if clock.now_ns() > until_ns:
            raise Timeout(f"the joints did not come to rest within {LONGEST_S:g} s")
        clock.sleep_until(clock.now_ns() + POLL_NS)
