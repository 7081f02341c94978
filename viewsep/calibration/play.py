"""Play between a joint's encoder and what it turns: the object follows only when the play is taken up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from viewsep.messages import FloatArray, JointState


def followed(encoder_rad: FloatArray, play_rad: float, start_rad: float | None = None) -> FloatArray:
    """(T,) encoder angles in order of time -> (T,) the object's: half the play behind in the direction of motion.

    `play_rad` is the whole dead band. Where the object is at first is not known: in its middle, or at `start_rad`.
    """
    half = 0.5 * play_rad
    at = float(encoder_rad[0]) if start_rad is None and len(encoder_rad) else start_rad or 0.0
    angles = []
    for encoder in encoder_rad.tolist():
        at = min(max(at, encoder - half), encoder + half)
        angles.append(at)
    return np.array(angles)


def held_states(
    history: Sequence[JointState], play_rad: Sequence[float], before: JointState | None = None
) -> tuple[JointState, ...]:
    """Read-backs in order of time -> the same with the object's angles. `before` is such a one from before them."""
    if not history:
        return ()
    encoder = np.array([state.position_rad for state in history])
    starts = [None] * encoder.shape[1] if before is None else list(before.position_rad)
    columns = [followed(encoder[:, k], play, starts[k]) for k, play in enumerate(play_rad)]
    held = np.stack(columns, axis=1).tolist()
    return tuple(replace(state, position_rad=tuple(at)) for state, at in zip(history, held, strict=True))
