"""How a task's result is worded and filled in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from viewsep.engine.state import EngineState
from viewsep.interfaces import Conclusion, Interpretation
from viewsep.messages import Outcome, Result


def identification(state: EngineState, belief: Interpretation) -> Result:
    """The leader of a rating is named (section V.B)."""
    leader = belief.estimate.candidates[belief.leader]
    others = [candidate for candidate in belief.estimate.candidates if candidate.name != leader.name]
    next_best = min(others, key=lambda candidate: candidate.rating)
    factor = next_best.rating / leader.rating
    reason = f"its path rates {factor:.1f} times better than that of {next_best.name} at a separating view"
    return _result(state, belief.estimate.stamp_ns, Outcome.IDENTIFIED, leader.name, reason)


def conclusion(state: EngineState, stamp_ns: int, concluded: Conclusion) -> Result:
    """What the interpreter is sure of, or that the planner sees no use in going on."""
    assert state.belief is not None
    named = ""
    if concluded.outcome is Outcome.IDENTIFIED:
        named = state.belief.estimate.candidates[state.belief.leader].name
    names = [candidate.name for candidate in state.belief.estimate.candidates]
    return replace(
        _result(state, stamp_ns, concluded.outcome, named, concluded.reason),
        indistinct=tuple(names[k] for k in concluded.indistinct),
        telling_view=concluded.telling_view,
    )


def pose_remark(belief: Interpretation, remark: str) -> Conclusion:
    """What `belief` concludes, with a remark on the pose that is not known as well as was asked for."""
    assert belief.conclusion is not None
    return replace(belief.conclusion, reason=f"{belief.conclusion.reason}; {remark}")


def indecision(state: EngineState, stamp_ns: int, reason: str) -> Result:
    """The budget is spent and no candidate stands out."""
    return _result(state, stamp_ns, Outcome.UNDECIDED, "", reason)


def failure(state: EngineState, stamp_ns: int, reason: str) -> Result:
    """The task could not be carried out."""
    return _result(state, stamp_ns, Outcome.FAILED, "", reason)


def _result(state: EngineState, stamp_ns: int, outcome: Outcome, name: str, reason: str) -> Result:
    candidates = state.estimate.candidates if state.estimate else ()
    best = next((c for c in candidates if c.name == name), min(candidates, key=lambda c: c.rating, default=None))
    posterior = best is not None and best.probability is not None
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
        pose_spread_rad=float(np.sqrt(best.variance)) if best and posterior else None,
    )
