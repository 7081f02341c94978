"""What the engine knows between two events."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from viewsep.interfaces import Interpretation, NextView
from viewsep.messages import Estimate, FloatArray, MoveTo, Phase, Result


@dataclass(frozen=True, slots=True)
class TaskLimits:
    """When the engine gives up: looks (the seed's 400 iterations), moves and frames that fail in a row.

    `look_every_rad` is how far the view must have turned to be looked at again: a percept that repeats the last one
    is no further evidence.
    """

    look_every_rad: float = 0.07
    max_looks: int = 400
    max_failed_moves: int = 3
    max_missing_frames: int = 20


@dataclass(frozen=True, eq=False, slots=True)
class EngineState:
    """All the engine knows. `estimate` and `result` are what it last published, None before."""

    phase: Phase = Phase.IDLE
    interpretation: Any = None
    planning: Any = None
    belief: Interpretation | None = None
    view_direction: FloatArray | None = None
    move: MoveTo | None = None
    move_plan: NextView | None = None
    judging: bool = False
    dwelling: bool = False
    commands: int = 0
    looks: int = 0
    travel_rad: float = 0.0
    comparisons: int = 0
    failed_moves: int = 0
    missing_frames: int = 0
    estimate: Estimate | None = None
    result: Result | None = None
