"""`viewsep recordings diff`."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from viewsep.cli.console import print_json, results
from viewsep.cli.service_options import Json
from viewsep.errors import BadInput
from viewsep.recordings.compare import COMPARABLE, Comparison, Difference, compare
from viewsep.recordings.reader import Recording, read_recording


def diff(
    a: Annotated[Path, typer.Argument(help="Recording (MCAP).", metavar="A", show_default=False)],
    b: Annotated[Path, typer.Argument(help="The other one.", metavar="B", show_default=False)],
    tolerance: Annotated[
        float, typer.Option(help="Floats may differ by this much, relative to the larger of them and 1; 0: no bit.")
    ] = 0.0,
    only: Annotated[
        str | None, typer.Option(help=f"Comma-separated: {', '.join(COMPARABLE)}.", show_default="everything")
    ] = None,
    json: Json = False,
) -> None:
    """Name the first difference of two recordings, and count what differs.

    First the engine's messages in their order, then read-backs, the engine's states, pictures, models, configuration
    and task. Numbers of messages count from 0. The wall clock and the build are no difference.

    Exit codes: 0 the same, 1 different, 2 bad input.

    Examples:

        viewsep recordings diff run.mcap again.mcap

        viewsep recordings diff run.mcap elsewhere.mcap --tolerance 1e-6 --only estimate,result
    """
    if not (math.isfinite(tolerance) and tolerance >= 0):
        raise BadInput(f"--tolerance {tolerance:g}: give a number from 0 on, such as 1e-6")
    chosen = [name.strip() for name in only.split(",")] if only is not None else []
    recordings = read_recording(a), read_recording(b)
    try:
        found = compare(*recordings, tolerance, chosen)
    except BadInput as error:
        raise BadInput(f"--only: {error}") from error
    start_ns = min((recorded.stamp_ns for recorded in recordings[0].messages), default=0)
    if json:
        print_json(_as_dict(a, b, found, tolerance, start_ns))
    else:
        _tell(found, tolerance, start_ns, recordings, bool(chosen))
    raise typer.Exit(0 if found.first is None else 1)


def _as_dict(a: Path, b: Path, found: Comparison, tolerance: float, start_ns: int) -> dict[str, Any]:
    """For JSON: times in seconds since A's first message."""
    return {
        "a": str(a),
        "b": str(b),
        "same": found.first is None,
        "tolerance": tolerance,
        "first": None if found.first is None else _difference(found.first, start_ns),
        "sequence": found.sequence or None,
        "equal_before": found.equal_before,
        "of": {"a": found.of[0], "b": found.of[1]},
        "equal_until_s": None if found.equal_until_ns is None else (found.equal_until_ns - start_ns) / 1e9,
        "topics": {topic: asdict(counted) for topic, counted in found.topics.items()},
        "about": [_difference(difference, start_ns) for difference in found.about],
        "notes": list(found.notes),
    }


def _difference(difference: Difference, start_ns: int) -> dict[str, Any]:
    time_s = None if difference.stamp_ns is None else (difference.stamp_ns - start_ns) / 1e9
    return asdict(difference) | {"time_s": time_s}


def _tell(
    found: Comparison, tolerance: float, start_ns: int, recordings: tuple[Recording, Recording], chosen: bool
) -> None:
    """The same for people."""
    how = "byte for byte" if tolerance == 0 else f"with floats within {tolerance:g}"
    if found.first is None:
        what = "what was chosen is the same" if chosen else "the same"
        _say(f"{what}, {how}: {sum(counted.a for counted in found.topics.values()):,} messages and pictures")
    else:
        _say(f"different ({how}); the first difference:")
        _say(f"  {found.first.text if found.sequence else f'{found.first.topic}: {found.first.text}'}")
    if found.sequence:
        until = "" if found.equal_until_ns is None else f", up to {(found.equal_until_ns - start_ns) / 1e9:.3f} s"
        of = f"{found.of[0]:,} messages in A, {found.of[1]:,} in B"
        _say(f"equal before it: {found.equal_before:,} of {of} ({found.sequence}){until}")
        table = Table("topic", "in A", "in B", "differ")
        for topic, counted in found.topics.items():
            if counted.a or counted.b:
                table.add_row(escape(topic), f"{counted.a:,}", f"{counted.b:,}", f"{counted.differing:,}")
        results.print(table)
    for difference in found.about:
        if difference is not found.first:
            _say(f"{difference.topic}: {difference.text}")
    for note in found.notes:
        _say(f"note: {note}")


def _say(text: str) -> None:
    results.print(text, soft_wrap=True, highlight=False, markup=False)
