"""Options of the commands that begin a task."""

from __future__ import annotations

from typing import Annotated

import typer

from viewsep.errors import BadInput

PoseTolerance = Annotated[
    float | None,
    typer.Option(
        metavar="DEG",
        help="Go on turning until the pose is known that well, too (degrees); needs an interpreter with probabilities.",
        show_default="the name is enough",
    ),
]
WIDEST_DEG = 180.0


def check_pose_tolerance(degrees: float | None) -> float | None:
    """Raises BadInput for what is no tolerance."""
    if degrees is not None and not 0.0 < degrees <= WIDEST_DEG:
        raise BadInput(f"--pose-tolerance {degrees:g}: give degrees above 0 and up to {WIDEST_DEG:g}, e.g. 5")
    return degrees
