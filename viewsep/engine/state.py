"""What the engine knows between two events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from viewsep.interfaces import Interpretation, NextView
from viewsep.messages import Estimate, FloatArray, FrameMissing, MoveTo, Phase, Result


@dataclass(frozen=True, slots=True)
class TaskLimits:
    """When the engine gives up: looks (the seed's 400 iterations), moves and frames that fail in a row.

    `look_every_rad` is how far the view must have turned to be looked at again: a percept that repeats the last one
    is no further evidence. `judge_within_rad` is how close to the separating view that was reached last the rating
    decides: further away the candidates look the same, and whoever leads there leads by chance. `confirming_looks` is
    at how many such looks in a row a candidate must lead to be named. A named object's pose must be known to
    `pose_tolerance_rad` (root mean squared angle) as well; infinite: the name is enough. And the share `look_around` of
    what the rig can show must have been seen: 0, the name is enough.
    """

    look_every_rad: float = 0.07
    judge_within_rad: float = 0.35
    confirming_looks: int = 3
    max_looks: int = 400
    max_failed_moves: int = 3
    max_missing_frames: int = 20
    pose_tolerance_rad: float = float("inf")
    look_around: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class EngineState:
    """All the engine knows. `estimate` and `result` are what it last published, None before.

    `view_direction` (3,) is that of the last look, `separating_view` (3,) the one reached last; `leads` says who led
    at the last look that was judged (or -1) and at how many such looks in a row; `dwelling` means that the rig stands
    and waits for a look. `missing_first` is the first of the frames that are missing now. `notes` is what was out of
    the ordinary, of which the first `told` were published with an estimate.
    """

    phase: Phase = Phase.IDLE
    interpretation: Any = None
    planning: Any = None
    belief: Interpretation | None = None
    view_direction: FloatArray | None = None
    move: MoveTo | None = None
    move_plan: NextView | None = None
    separating_view: FloatArray | None = None
    leads: tuple[int, int] = (-1, 0)
    dwelling: bool = False
    commands: int = 0
    looks: int = 0
    travel_rad: float = 0.0
    comparisons: int = 0
    failed_moves: int = 0
    missing_frames: int = 0
    missing_first: FrameMissing | None = None
    notes: tuple[str, ...] = ()
    told: int = 0
    estimate: Estimate | None = None
    result: Result | None = None
