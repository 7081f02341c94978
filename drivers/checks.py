"""What is looked at when hardware is examined: one check after the other, with what was found and the remedy."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Verdict(StrEnum):
    """Of one check; what could be better does not fail."""

    GOOD = "pass"
    BETTER = "could be better"
    BAD = "fail"


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was looked at: what was found, and the remedy where it is not good."""

    name: str
    verdict: Verdict
    found: str
    remedy: str = ""


def check(name: str, good: bool, found: str, remedy: str, otherwise: Verdict = Verdict.BAD) -> Check:
    """A check that is good or not; the remedy is told where it is not."""
    return Check(name, Verdict.GOOD, found) if good else Check(name, otherwise, found, remedy)
