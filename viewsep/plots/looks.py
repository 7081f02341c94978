"""A picture of who is right after how many looks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator, PercentFormatter

from viewsep.plots.answers import plain
from viewsep.plots.bench import COLOURS, DPI, headline, make_folder
from viewsep.plots.contact_sheet import short_name, write_png


def draw_looks(found: dict[str, Any], folder: Path) -> list[Path]:
    """Write `looks.png`; returns what was written.

    The folder is made where it is missing; raises BadInput where that is impossible.
    """
    make_folder(folder)
    write_png(looks(found), folder / "looks.png")
    return [folder / "looks.png"]


def looks(found: dict[str, Any]) -> Figure:
    """The share that is right over the number of looks, with Wilson's intervals, a line per method."""
    figure = Figure(figsize=(9.0, 6.0), dpi=DPI, layout="constrained", facecolor="white")
    axes = figure.subplots()
    for place, (name, after) in enumerate(found["after"].items()):
        share = np.array([each["right"] / each["tasks"] for each in after])
        low, high = np.array([each["right_wilson95"] for each in after]).T
        number = np.arange(1, len(after) + 1) + 0.06 * place  # beside each other
        error = np.maximum([share - low, high - share], 0.0)
        style: dict[str, Any] = {"color": COLOURS[place % len(COLOURS)], "capsize": 2, "marker": "o", "ms": 5}
        axes.errorbar(number, share, yerr=error, label=plain(short_name(name, 30)), **style)
    axes.set_xlabel("looks")
    axes.set_ylabel("right (bars: 95 %, Wilson)")
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    axes.grid(color="0.92")
    axes.legend(frameon=False)
    headline(figure, f"Who is right after how many looks: {len(found['tasks'])} tasks, the same pictures for all")
    return figure
