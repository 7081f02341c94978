"""What a benchmark notes while a task runs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from viewsep.messages import Estimate, FloatArray, Message, PerceptReceived


class Observer:
    """A `Listener` that keeps the first view looked at and the course of every estimate."""

    def __init__(self) -> None:
        self.start: FloatArray | None = None
        self.estimates: list[Estimate] = []
        self._view: FloatArray | None = None

    def hear(self, stamp_ns: int, message: Message) -> None:
        """Note views and estimates."""
        if isinstance(message, PerceptReceived):
            self._view = message.percept.view_direction
        elif isinstance(message, Estimate):
            if self.start is None:
                self.start = self._view
            if not self.estimates or message.iteration > self.estimates[-1].iteration:
                self.estimates.append(message)

    def comparisons(self) -> list[float]:
        """Feature comparisons per candidate in every iteration (the seed's Fig. 6c)."""
        return [estimate.comparisons / len(estimate.candidates) for estimate in self.estimates]

    def comparisons_converged(self) -> float | None:
        """Their median over the iterations in which the poses of all candidates have converged; None without any."""
        settled = [
            comparisons
            for comparisons, estimate in zip(self.comparisons(), self.estimates, strict=True)
            if all(candidate.converged for candidate in estimate.candidates)
        ]
        return float(np.median(settled)) if settled else None

    def course(self, truth: str) -> Mapping[str, Any]:
        """For pictures: phases, comparisons, and w1 in degrees of the truth and of its closest rival (Fig. 6b)."""
        courses = {
            candidate.name: [round(float(np.degrees(estimate.candidates[k].w1)), 2) for estimate in self.estimates]
            for k, candidate in enumerate(self.estimates[-1].candidates if self.estimates else ())
        }
        rivals = sorted((name for name in courses if name != truth), key=lambda name: courses[name][-1])
        return {
            "phase": [estimate.phase.value for estimate in self.estimates],
            "comparisons": [round(value, 2) for value in self.comparisons()],
            "w1_deg": {name: courses[name] for name in [truth, *rivals[:1]] if name in courses},
        }
