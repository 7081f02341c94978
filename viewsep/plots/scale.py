"""Pictures of what a step costs with more and more candidates."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from viewsep.plots.answers import plain
from viewsep.plots.bench import COLOURS, DOTTED, DPI, headline, make_folder
from viewsep.plots.contact_sheet import short_name, write_png

TIMES = {"interpret": ("interpreting a look", "o"), "plan": ("planning a view", "s")}
MEMORY = {"models_mb": ("the candidates' models", "o"), "engine_mb": ("the engine, beside them", "s")}


def draw_scale(found: dict[str, Any], folder: Path) -> list[Path]:
    """Write `scale.png`: times and memory over the number of candidates, both logarithmic; returns what was written.

    The folder is made where it is missing; raises BadInput where that is impossible.
    """
    make_folder(folder)
    write_png(scale(found), folder / "scale.png")
    return [folder / "scale.png"]


def scale(found: dict[str, Any]) -> Figure:
    """Medians of the times with their 95th percentiles, and what the memory of the process grew by."""
    figure = Figure(figsize=(13.0, 6.4), dpi=DPI, layout="constrained", facecolor="white")
    times, memory = figure.subplots(1, 2)
    methods = list(dict.fromkeys(row["method"] for row in found["rows"]))
    for place, method in enumerate(methods):
        rows = [row for row in found["rows"] if row["method"] == method]
        counts = [row["candidates"] for row in rows]
        name = short_name(method, 30)
        style: dict[str, Any] = {"color": COLOURS[place % len(COLOURS)], "lw": 1.8}
        for what, (says, marker) in TIMES.items():
            style |= {"ls": "-" if what == "interpret" else "--"}
            label = plain(f"{name}: {says}")
            times.plot(counts, [row[f"{what}_ms_median"] for row in rows], marker=marker, label=label, **style)
            times.plot(counts, [row[f"{what}_ms_p95"] for row in rows], **style | {"lw": 0.9, "alpha": 0.6})
        for key, (says, marker) in MEMORY.items():
            style |= {"ls": "-" if key == "models_mb" else "--"}
            drawn = [max(row[key], 0.1) for row in rows]
            memory.plot(counts, drawn, marker=marker, label=plain(f"{name}: {says}"), **style)
    learning = found["learning"]["wall_s_median"]
    _finish(times, "milliseconds (thin: 95th percentile)")
    _finish(memory, "MB of memory")
    rate = found["about"]["config"]["task"]["looks_per_s"]
    times.axhline(1e3 / rate, color="0.4", lw=1.2, ls=DOTTED)
    times.annotate(
        f"{rate:g} looks a second", (0.99, 1e3 / rate), xycoords=("axes fraction", "data"), ha="right", va="bottom"
    )
    headline(figure, f"What a step costs on one core; an object is learned in {learning:.2f} s")
    return figure


def _finish(axes: Axes, quantity: str) -> None:
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("candidates")
    axes.set_ylabel(quantity)
    axes.grid(which="both", color="0.92")
    axes.legend(loc="upper left", frameon=False, fontsize=9.5)
