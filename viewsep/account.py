"""How a task ended, as a person would say it: the same words on the command line, in logs and on pages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from viewsep.messages import Outcome, Result

NONE_OF_THEM = "none of them"
"""What a table calls the case that the object is no candidate; no model can be called so."""


@dataclass(frozen=True, slots=True)
class Account:
    """A result in plain words and degrees: `outcome` may be one that this version does not know.

    `telling_view_deg` (azimuth, elevation) and `pose_spread_deg` are None where there is none.
    """

    outcome: str
    object: str
    reason: str
    indistinct: tuple[str, ...] = ()
    telling_view_deg: tuple[float, float] | None = None
    pose_spread_deg: float | None = None

    @classmethod
    def of(cls, result: Result) -> Account:
        """That of an engine's result."""
        return cls(
            result.outcome.value,
            result.object,
            result.reason,
            result.indistinct,
            telling_view_deg(result),
            pose_spread_deg(result),
        )

    @property
    def answer(self) -> str:
        """What the object is said to be; empty where that was left open."""
        if self.outcome == Outcome.UNKNOWN:
            return "none of the candidates"
        return either(self.indistinct) if self.outcome == Outcome.INDISTINGUISHABLE else self.object

    @property
    def grounds(self) -> str:
        """Why, as part of a sentence, with the view that would help."""
        if self.telling_view_deg is None:
            return self.reason
        return f"{self.reason}; {view_in_words(*self.telling_view_deg)} would, which it cannot reach"

    @property
    def ending(self) -> str:
        """The outcome with what the object is said to be."""
        if not self.answer:
            return self.outcome
        return f"{self.outcome}{' as' if self.outcome == Outcome.IDENTIFIED else ','} {self.answer}"

    @property
    def sentence(self) -> str:
        """All of it but the pose."""
        return f"It is {self.answer}: {self.grounds}." if self.answer else f"{self.outcome}: {self.grounds}."

    @property
    def pose(self) -> str:
        """How well the pose of what it is said to be is known; empty where there is none, or nobody knows."""
        if self.outcome not in (Outcome.IDENTIFIED, Outcome.INDISTINGUISHABLE) or self.pose_spread_deg is None:
            return ""
        return f"pose known to ±{self.pose_spread_deg:.{0 if self.pose_spread_deg >= 1.0 else 1}f}°"


def telling_view_deg(result: Result) -> tuple[float, float] | None:
    """Azimuth and elevation of a result's telling view in degrees, None where it has none."""
    if result.telling_view is None:
        return None
    from viewsep.geometry import azimuth_elevation  # scipy is slow to import

    azimuth, elevation = azimuth_elevation(result.telling_view)
    return float(np.degrees(azimuth)), float(np.degrees(elevation))


def pose_spread_deg(result: Result) -> float | None:
    """By how much a result's pose may be wrong, in degrees; None where that is not known."""
    spread = result.pose_spread_rad
    return float(np.degrees(spread)) if spread is not None and np.isfinite(spread) else None


def either(names: Sequence[str]) -> str:
    """`a`, `a or b`, `a, b or c`."""
    return " or ".join([*([", ".join(names[:-1])] if len(names) > 1 else []), *names[-1:]])


def view_in_words(azimuth_deg: float, elevation_deg: float) -> str:
    """A view direction in whole degrees."""
    return f"azimuth {round(azimuth_deg)}°, elevation {round(elevation_deg)}°"


def percent(probability: float) -> str:
    """A probability for people; only what is certain is 0 or 100 %."""
    if 0.0 < probability < 0.0005:
        return "< 0.1 %"
    return "> 99.9 %" if 0.9995 <= probability < 1.0 else f"{100.0 * probability:.1f} %"
