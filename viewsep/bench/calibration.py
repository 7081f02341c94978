"""Whether probabilities mean what they say: those of every look of a task, beside what is true.

Nothing ends a task but its number of looks (or a planner that sees no use in going on): the looks after a candidate is
almost certain count as well.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from viewsep.bench.journal import Row
from viewsep.bench.methods import Method
from viewsep.bench.observer import Observer
from viewsep.bench.separation import carry_out
from viewsep.bench.setup import Setup
from viewsep.bench.summary import verdict
from viewsep.bench.tasks import SeparationTask
from viewsep.engine.engine import Engine
from viewsep.errors import BadInput
from viewsep.geometry import spherical_direction
from viewsep.interfaces import Interpretation, Interpreter
from viewsep.messages import Estimate, FloatArray, HypothesisViews, Percept
from viewsep.plugins import make_descriptor, make_interpreter

CONFIDENCE = 0.99  # the probability at which a task would have been decided


class Undecided:
    """An interpreter that believes what `interpreter` does, but concludes nothing and has no leader.

    No option does that: a posterior's probability, a sum of many, may come out a little above 1.
    """

    def __init__(self, interpreter: Interpreter) -> None:
        self._interpreter = interpreter
        self.state_type = interpreter.state_type

    def start(self) -> Any:
        """The state before the first percept."""
        return self._interpreter.start()

    def update(self, state: Any, percept: Percept) -> tuple[Any, Interpretation]:
        """One iteration, without its conclusion."""
        state, belief = self._interpreter.update(state, percept)
        return state, replace(belief, leader=-1, conclusion=None)

    def hypotheses(self, state: Any, stamp_ns: int) -> HypothesisViews:
        """Where the hypotheses in `state` see the object from."""
        return self._interpreter.hypotheses(state, stamp_ns)


@dataclass(frozen=True, slots=True)
class Decision:
    """How a task would have ended: after `look` looks `named` (empty: none of the candidates) was that probable."""

    look: int
    named: str
    probability: float


def check_probabilities(task: SeparationTask, method: Method, setup: Setup) -> None:
    """Raises BadInput where the method's interpreter has no probabilities; tried on the task's models."""
    models = [setup.model(source, method.config) for source in task.candidates]
    descriptor = make_descriptor(method.config.descriptor)
    interpreter = make_interpreter(method.config.interpreter, models, descriptor)
    percept = Percept(0, 0, descriptor.name, models[0].features[0], spherical_direction(0.0, 0.0))
    _, belief = interpreter.update(interpreter.start(), percept)
    if any(candidate.probability is None for candidate in belief.estimate.candidates):
        raise BadInput(
            f"the interpreter {method.config.interpreter.name!r} has no probabilities that could be calibrated: name "
            "one that has, such as --interpreter filter"
        )


def calibration_row(task: SeparationTask, method: Method, setup: Setup) -> Row:
    """Carry out the task to its last look; `probabilities` is a list per look: each candidate's, then that of none."""
    run = carry_out(task, method, setup, _endless)
    row: Row = {
        "index": task.index,
        "seed": task.seed,
        "method": method.name,
        "truth": task.truth,
        "known": task.known,
        "identical": task.identical,
        "candidates": [model.name for model in run.models],
    }
    if run.result is None:
        failed = {"outcome": "failed", "verdict": "failed", "object": "", "reason": run.failure}
        return row | failed | {"looks": 0, "probabilities": [], "unknown_probability": None, "decision": None}
    probabilities = probabilities_of(run.observer)
    decision = decision_of(probabilities, row["candidates"])
    outcome = "undecided" if decision is None else "identified" if decision.named else "unknown"
    named = decision.named if decision else ""
    return row | {
        "outcome": outcome,
        "object": named,
        "verdict": verdict(outcome, named, task.truth, task.known, task.identical),
        "looks": run.result.looks,
        "reason": run.result.reason,
        "probabilities": probabilities.tolist(),
        "unknown_probability": float(probabilities[-1, -1]) if len(probabilities) else None,
        "decision": None if decision is None else {"look": decision.look, "probability": decision.probability},
    }


def probabilities_of(observer: Observer) -> FloatArray:
    """(L, K + 1) at every look: the candidates' probabilities and that of none of them, which sum to 1."""
    told = np.array([_probabilities(estimate) for estimate in observer.estimates], np.float64)
    if not len(told):
        return np.empty((0, 0))
    return np.asarray(told / told.sum(axis=1, keepdims=True))


def decision_of(probabilities: FloatArray, names: Sequence[str]) -> Decision | None:
    """At the first look at which one of the candidates, or none of them, is at least `CONFIDENCE` probable."""
    for look, row in enumerate(probabilities, start=1):
        best = int(np.argmax(row))
        if row[best] >= CONFIDENCE:
            return Decision(look, names[best] if best < len(names) else "", float(row[best]))
    return None


def _endless(engine: Engine) -> Engine:
    return Engine(Undecided(engine.interpreter), engine.planner, engine.limits, engine.reachable)


def _probabilities(estimate: Estimate) -> list[float]:
    return [*(candidate.probability or 0.0 for candidate in estimate.candidates), estimate.unknown or 0.0]
