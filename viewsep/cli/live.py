"""The live table: what the engine believes while it works."""

from __future__ import annotations

from typing import Any

import numpy as np
from rich.live import Live
from rich.table import Table
from rich.text import Text

from viewsep.cli.console import people
from viewsep.cli.status_tables import candidate_table
from viewsep.geometry import azimuth_elevation
from viewsep.messages import Estimate, Message, PerceptReceived
from viewsep.service.board import candidate_status


class LiveTable:
    """A `Listener` that redraws candidates, ratings, poses, phase and whatever was noted; on terminals only.

    `truth` is marked.
    """

    def __init__(self, truth: str = "") -> None:
        self._truth = truth
        self._view = ""
        self._notes: dict[int, str] = {}  # of each look: the last estimate is told again as the task ends
        self._live = Live(console=people, auto_refresh=False, transient=True)
        self._active = people.is_terminal

    def __enter__(self) -> LiveTable:
        if self._active:
            self._live.start()
        return self

    def __exit__(self, *_: Any) -> None:
        self._live.stop()

    def hear(self, stamp_ns: int, message: Message) -> None:
        """Redraw on every estimate."""
        if not self._active:
            return
        if isinstance(message, PerceptReceived):
            azimuth, elevation = np.degrees(azimuth_elevation(message.percept.view_direction))
            self._view = f"view az {azimuth:.0f}° el {elevation:.0f}°"
        elif isinstance(message, Estimate):
            if message.note:
                self._notes[message.iteration] = message.note
            self._live.update(self._table(message), refresh=True)

    def _table(self, estimate: Estimate) -> Table:
        title = (
            f"look {estimate.iteration}, {estimate.phase}, {self._view}, travel {np.degrees(estimate.travel_rad):.0f}°"
        )
        candidates = tuple(map(candidate_status, estimate.candidates))
        table = candidate_table(candidates, estimate.unknown, title, self._truth)
        table.caption = Text("\n".join(f"look {look}: {note}" for look, note in self._notes.items()))
        return table
