"""`viewsep rig board`."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Annotated

import typer

from viewsep.calibration.board import Board
from viewsep.cli.board_options import Columns, Rows, SquareMm, board_of
from viewsep.cli.console import people
from viewsep.errors import BadInput
from viewsep.files import write_whole

DPI = 300
MARGIN_M = 0.005
FORMATS = ("png", "pdf")
MM_PER_INCH = 25.4


def board(
    out: Annotated[Path, typer.Option("--out", "-o", help="PNG or PDF to write.", show_default=False)],
    columns: Columns = 7,
    rows: Rows = 5,
    square_mm: SquareMm = 20.0,
) -> None:
    """Write the board for `viewsep rig calibrate board`; print it at its own size and glue it on something flat.

    Examples:

        viewsep rig board --out board.pdf

        viewsep rig board --out board.png --columns 9 --rows 6 --square-mm 15
    """
    kind = out.suffix.lower().removeprefix(".")
    if kind not in FORMATS:
        raise BadInput(f"--out {out}: the board is written as .png or .pdf; choose one of these endings")
    wide, high = _write(board_of(columns, rows, square_mm), out, kind)
    people.print(
        f"{out}: {wide:.0f} x {high:.0f} mm; measure a square on the print, it must be {square_mm:g} mm",
        soft_wrap=True,
        highlight=False,
    )


def _write(board: Board, out: Path, kind: str) -> tuple[float, float]:
    """Width and height in millimetres."""
    from matplotlib.figure import Figure  # slow to import

    picture = board.picture(DPI, MARGIN_M)
    high, wide = picture.shape
    figure = Figure(figsize=(wide / DPI, high / DPI), dpi=DPI)
    figure.figimage(picture, cmap="gray", vmin=0, vmax=255)
    buffer = BytesIO()
    undated = {"CreationDate": None} if kind == "pdf" else {}
    figure.savefig(buffer, format=kind, dpi=DPI, metadata=undated)
    write_whole(out, buffer.getvalue(), "board")
    return wide / DPI * MM_PER_INCH, high / DPI * MM_PER_INCH
