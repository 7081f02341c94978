"""Whether the object is still held as it was: a pose that was known and has become another one tells of a slip."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from viewsep.geometry import rotation_angle
from viewsep.interfaces import Interpretation
from viewsep.messages import FloatArray

SHIFTED_RAD = np.radians(25.0)  # a smaller change is none that anybody needs to know of
AGREED = 3  # looks after which a pose is believed: at first it may be a wrong one
SHIFTED_SPREADS = 3.0  # of both poses together: nor one that may be an error


@dataclass(frozen=True, eq=False, slots=True)
class Held:
    """How candidates were held when their pose was known last; `Held()` knows nothing.

    `who` (M,) are their indices, `rotations` (M, 3, 3) object -> control, known to `spreads_rad` (M,), `looks` (M,) how
    many looks agreed on that. `shifts` counts how often a pose was another one than before.
    """

    who: tuple[int, ...] = ()
    rotations: FloatArray = field(default_factory=lambda: np.empty((0, 3, 3)))
    spreads_rad: FloatArray = field(default_factory=lambda: np.empty(0))
    looks: tuple[int, ...] = ()
    shifts: int = 0


def compared(held: Held, now: Interpretation) -> tuple[Held, Interpretation]:
    """Compare the likeliest candidate's pose, if that is known now, with the one known before, and note a slip."""
    if now.converged:
        held, turned_rad = _remembered(held, now)
        if turned_rad:
            note = f"its pose has changed by {np.degrees(turned_rad):.0f} deg, as if the object had slipped"
            now = replace(now, estimate=replace(now.estimate, note=note))
    if held.shifts and now.conclusion:
        reason = f"{now.conclusion.reason}, on the way its pose changed as if it had slipped"
        now = replace(now, conclusion=replace(now.conclusion, reason=reason))
    return held, now


def _remembered(held: Held, now: Interpretation) -> tuple[Held, float]:
    """With the pose that is known now; by how much it has changed, 0 where it has not."""
    candidates = now.estimate.candidates
    who = min(range(len(candidates)), key=lambda k: candidates[k].rating)
    rotation, spread_rad = now.rotations[who], float(np.sqrt(candidates[who].variance))
    others = [k for k, other in enumerate(held.who) if other != who]
    looks, changed_rad = 1, 0.0
    if who in held.who:
        before = held.who.index(who)
        turned_rad = float(rotation_angle(held.rotations[before], rotation))
        if turned_rad <= max(SHIFTED_RAD, SHIFTED_SPREADS * float(np.hypot(spread_rad, held.spreads_rad[before]))):
            looks = held.looks[before] + 1
        elif held.looks[before] >= AGREED:
            others, changed_rad = [], turned_rad
    return Held(
        (*(held.who[k] for k in others), who),
        np.concatenate([held.rotations[others], rotation[None]]),
        np.append(held.spreads_rad[others], spread_rad),
        (*(held.looks[k] for k in others), looks),
        held.shifts + bool(changed_rad),
    ), changed_rad
