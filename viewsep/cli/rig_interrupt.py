"""Ctrl-C while servos move: it is noted, and whoever moves them ends in good order."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

import typer

from viewsep.cli.exit_codes import EXIT_INTERRUPTED
from viewsep.errors import Interrupted
from viewsep.messages import JointState


@contextmanager
def interrupt_noted() -> Iterator[Callable[[], bool]]:
    """Gives a function that says whether Ctrl-C was pressed; leaves with exit code 130 if it was."""
    pressed: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        pressed.append(number)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield lambda: bool(pressed)
    finally:
        signal.signal(signal.SIGINT, before)
    if pressed:
        raise typer.Exit(EXIT_INTERRUPTED)


def unless(ended: Callable[[], bool], saying: str = "stopped on the way") -> Callable[[JointState], None]:
    """Hears of read-backs, and raises Interrupted once Ctrl-C was pressed."""

    def watch(_state: JointState) -> None:
        if ended():
            raise Interrupted(saying)

    return watch
