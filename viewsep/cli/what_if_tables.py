"""What other methods would have made of recordings: as tables, and for JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.measure import Measurement
from rich.table import Table

from viewsep.cli.console import results
from viewsep.cli.what_if import Compared, Method
from viewsep.recordings.tally import is_right, tally
from viewsep.recordings.what_if import Course

RECORDED = "recorded"
COSTS = ("looks", "deg", "compared")
COUNTS = {
    "right": "right",
    "wrong": "wrong",
    "unchecked": "truth unknown",
    "unknown": "unknown",
    "indistinguishable": "indistinguishable",
    "undecided": "undecided",
    "failed": "failed",
    "recording_ends": "recording ends",
    "agree": "agree",
    "differ": "differ",
}
RARE = ("unchecked", "unknown", "indistinguishable", "failed")
WIDEST = 1000
AGREE = {True: "yes", False: "no", None: "-"}


def tell(compared: Sequence[Compared], methods: Sequence[Method]) -> None:
    """A table a method, a line a recording, what was recorded at its side; then a line a method."""
    for number, method in enumerate(methods):
        _print(_side_by_side(compared, method.name, [row.courses[number] for row in compared]))
    _print(_summary(compared, methods))
    results.print(
        "deg: travel on the view sphere; leads: from this look on the one rated best stayed the same; medians are over "
        "those that named an object",
        style="dim",
    )
    for row in compared:
        if row.gaps:
            where = "one place" if row.gaps == 1 else f"{row.gaps} places"
            results.print(f"note: {row.name}: messages are missing in {where}", markup=False, soft_wrap=True)


def as_dict(compared: Sequence[Compared], methods: Sequence[Method]) -> dict[str, Any]:
    """For JSON: degrees, null where there is nothing."""
    names = [RECORDED, *(method.name for method in methods)]
    return {
        "methods": names,
        "recordings": [
            {
                "recording": row.name,
                "files": list(row.files),
                "truth": row.truth or None,
                "gaps": row.gaps,
                "courses": [
                    {"method": name, **_course(course, row)} for name, course in zip(names, _courses(row), strict=True)
                ],
            }
            for row in compared
        ],
        "summary": [{"method": name, **summary} for name, summary in zip(names, _tallies(compared), strict=True)],
    }


def _courses(row: Compared) -> tuple[Course, ...]:
    return (row.recorded, *row.courses)


def _course(course: Course, row: Compared) -> dict[str, Any]:
    return {
        "outcome": course.ending.value,
        "object": course.object or None,
        "indistinct": list(course.indistinct),
        "right": is_right(course, row.truth),
        "reason": course.reason,
        "looks": course.looks,
        "travel_deg": float(np.degrees(course.travel_rad)),
        "comparisons": course.comparisons,
        "leading": course.leading or None,
        "leads_since": course.leads_since or None,
        "agrees": course.agrees(row.recorded),
    }


def _tallies(compared: Sequence[Compared]) -> list[dict[str, Any]]:
    """One for every method, the recorded one first."""
    truths = [row.truth for row in compared]
    recorded = [row.recorded for row in compared]
    tallies = []
    for courses in zip(*map(_courses, compared), strict=True):
        counted = asdict(tally(courses, recorded, truths))
        counted["travel_deg_median"] = float(np.degrees(counted.pop("travel_median_rad")))
        tallies.append(counted)
    return tallies


def _side_by_side(compared: Sequence[Compared], name: str, courses: Sequence[Course]) -> Table:
    table = Table(title=escape(name), title_justify="left", box=SIMPLE_HEAD)
    for title in ("recording", "truth", RECORDED):
        table.add_column(title)
    for title in COSTS:
        table.add_column(title, justify="right")
    table.add_column("what if")
    for title in (*COSTS, "leads"):
        table.add_column(title, justify="right")
    table.add_column("agree")
    for row, course in zip(compared, courses, strict=True):
        table.add_row(
            escape(_short(row)),
            escape(row.truth),
            _decision(row.recorded, row.truth),
            *_costs(row.recorded),
            _decision(course, row.truth),
            *_costs(course),
            str(course.leads_since or "-"),
            AGREE[course.agrees(row.recorded)],
        )
    return table


def _short(row: Compared) -> str:
    """The name of the file, which says most; JSON has the whole path."""
    first, *others = (Path(file).name for file in row.files)
    return f"{first} +{len(others)}" if others else first


def _decision(course: Course, truth: str) -> str:
    """Right or wrong where the truth is known, otherwise who was named."""
    match is_right(course, truth):
        case True:
            return "right"
        case False:
            return f"[red]wrong[/red]: {escape(course.object)}"
    return escape(course.object) or course.ending.value


def _costs(course: Course) -> tuple[str, str, str]:
    return str(course.looks), f"{np.degrees(course.travel_rad):.0f}", f"{course.comparisons:,}"


def _summary(compared: Sequence[Compared], methods: Sequence[Method]) -> Table:
    """A line a method; what none of them did is left out, but for the usual answers."""
    tallies = _tallies(compared)
    shown = [key for key in COUNTS if key not in RARE or any(counted[key] for counted in tallies)]
    table = Table("method", box=SIMPLE_HEAD)
    for title in (*(COUNTS[key] for key in shown), "median looks", "median deg"):
        table.add_column(title, justify="right")
    for name, counted in zip([RECORDED, *(method.name for method in methods)], tallies, strict=True):
        table.add_row(
            escape(name),
            *(str(counted[key]) for key in shown),
            _number(counted["looks_median"]),
            _number(counted["travel_deg_median"]),
        )
    return table


def _number(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:g}" if value == round(value) else f"{value:.1f}"


def _print(table: Table) -> None:
    """As wide as it is: cells that are cut off say nothing, a line that the terminal breaks still does."""
    width = Measurement.get(results, results.options.update(max_width=WIDEST), table).maximum
    Console(width=max(width, results.width)).print(table)
