"""Options that say what the printed board is like."""

from __future__ import annotations

from typing import Annotated

import typer

from viewsep.calibration.board import Board
from viewsep.errors import BadInput

MOST_MARKERS = 50  # of the dictionary

Columns = Annotated[int, typer.Option(min=3, max=20, help="Squares in a row of the board.")]
Rows = Annotated[int, typer.Option(min=3, max=20, help="Rows of squares.")]
SquareMm = Annotated[float, typer.Option(min=2.0, max=200.0, help="Side of a square, as measured on the print.")]


def board_of(columns: int, rows: int, square_mm: float) -> Board:
    """The board. Raises BadInput where it would need more markers than there are."""
    if columns * rows // 2 > MOST_MARKERS:
        raise BadInput(
            f"--columns {columns} --rows {rows}: a board has {MOST_MARKERS} markers at the most, one for every other "
            "square; use fewer squares"
        )
    return Board(columns, rows, square_mm / 1000.0)
