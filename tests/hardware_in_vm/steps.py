"""Steps with a clear PASS or FAIL, on the host as in the machine."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

T = TypeVar("T")


@contextmanager
def step(name: str) -> Iterator[Callable[[str], None]]:
    """Print the step's outcome and what was noted by the function it gives. A failed step ends the program: code 1."""
    notes: list[str] = []
    begin = time.monotonic()
    try:
        yield notes.append
    except Exception as error:
        _tell(f"FAIL {name}: {type(error).__name__}: {error}", notes)
        sys.exit(1)
    _tell(f"PASS {name} ({time.monotonic() - begin:.1f} s)", notes)


def _tell(outcome: str, notes: list[str]) -> None:
    say("\n       ".join([outcome, *notes]))


def say(line: str) -> None:
    """Print a line at once. In the machine, `@word` tells the host how far the program is."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def expect(holds: bool, otherwise: str) -> None:
    """Raises AssertionError, also where Python leaves out `assert`."""
    if not holds:
        raise AssertionError(otherwise)


def wait_until(what: str, timeout_s: float, look: Callable[[], T | None]) -> T:
    """The first result of `look` that is true. Raises TimeoutError."""
    deadline = time.monotonic() + timeout_s
    while not (result := look()):
        if time.monotonic() > deadline:
            raise TimeoutError(f"{what}: not within {timeout_s:.0f} s")
        time.sleep(0.02)
    return result
