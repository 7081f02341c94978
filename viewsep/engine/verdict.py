"""How a task's result is worded and filled in."""

from __future__ import annotations

import numpy as np

from viewsep.engine.state import EngineState
from viewsep.interfaces import Interpretation
from viewsep.messages import Outcome, Result


def identification(state: EngineState, belief: Interpretation) -> Result:
    """The leader is named (section V.B)."""
    leader = belief.estimate.candidates[belief.leader]
    others = [candidate for candidate in belief.estimate.candidates if candidate.name != leader.name]
    next_best = min(others, key=lambda candidate: candidate.rating)
    factor = next_best.rating / leader.rating
    seed = f"its path rates {factor:.1f} times better than that of {next_best.name} at a separating view"
    reason = belief.reason or seed
    return _result(state, belief.estimate.stamp_ns, Outcome.IDENTIFIED, leader.name, reason)


def indecision(state: EngineState, stamp_ns: int, reason: str) -> Result:
    """The budget is spent and no candidate stands out."""
    return _result(state, stamp_ns, Outcome.UNDECIDED, "", reason)


def failure(state: EngineState, stamp_ns: int, reason: str) -> Result:
    """The task could not be carried out."""
    return _result(state, stamp_ns, Outcome.FAILED, "", reason)


def _result(state: EngineState, stamp_ns: int, outcome: Outcome, name: str, reason: str) -> Result:
    candidates = state.estimate.candidates if state.estimate else ()
    best = next((c for c in candidates if c.name == name), min(candidates, key=lambda c: c.rating, default=None))
    return Result(
        stamp_ns=stamp_ns,
        outcome=outcome,
        object=name,
        reason=reason,
        ratings=tuple((candidate.name, candidate.rating) for candidate in candidates),
        rotation=best.rotation if best else np.eye(3),
        looks=state.looks,
        travel_rad=state.travel_rad,
        comparisons=state.comparisons,
    )
