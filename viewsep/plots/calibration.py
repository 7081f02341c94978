"""Pictures of a calibration: whether what was called probable came true as often, and how unknown objects stand out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from viewsep.bench.calibration import CONFIDENCE
from viewsep.bench.report import Report
from viewsep.bench.roc import roc_curve
from viewsep.bench.summary import unknown_probabilities
from viewsep.plots.answers import plain
from viewsep.plots.bench import COLOURS, DASHED, DPI, headline, line_style, write_pictures
from viewsep.plots.contact_sheet import short_name
from viewsep.plots.sphere import RED

KINDS = {"leader": "whoever was most probable", "every": "every candidate, and none of them"}
BINS = {"equal_width": ("ten bins of equal width", "o"), "equal_count": ("ten bins of as many looks", "s")}


def draw_calibration(report: Report, folder: Path) -> list[Path]:
    """Write `reliability.png` and, where objects were unknown, `unknown.png`; returns what was written.

    The folder is made where it is missing; raises BadInput where that is impossible.
    """
    return write_pictures(report, folder, {"reliability": reliability, "unknown": unknown_roc})


def reliability(report: Report) -> Figure | None:
    """A reliability diagram per method (rows) and kind of prediction (columns); None when no task had a look."""
    summaries = {method: s for method, s in report.summaries().items() if s["looks"]}
    if not summaries:
        return None
    size = (12.0, 1.3 + 6.6 * len(summaries))
    figure = Figure(figsize=size, dpi=DPI, layout="constrained", facecolor="white")
    grid = figure.subplots(
        2 * len(summaries), len(KINDS), squeeze=False, sharex=True, height_ratios=(5, 1) * len(summaries)
    )
    for place, (method, summary) in enumerate(summaries.items()):
        for column, (kind, says) in enumerate(KINDS.items()):
            axes, below = grid[2 * place, column], grid[2 * place + 1, column]
            bins = summary["reliability"][kind]
            _draw_bins(axes, bins)
            _draw_numbers(below, bins["equal_width"])
            key = "ece" if kind == "leader" else "ece_every"
            low, high = summary[f"{key}_bootstrap95"]
            error = f"calibration error {summary[key]:.3f} ({low:.3f} - {high:.3f})"
            axes.set_title(plain(f"{short_name(method, 40)}: {says}\n{error}"), size=10.5, loc="left")
    handles, labels = grid[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower left", ncols=3, frameon=False, fontsize=10)
    tasks = len(report.of(report.methods[0]))
    headline(figure, f"What was called probable, and what came true: {tasks} tasks, all looks")
    return figure


def _draw_bins(axes: Axes, reliability: dict[str, Sequence[dict[str, Any]]]) -> None:
    """What came true over what was predicted, both kinds of bins."""
    axes.plot([0, 1], [0, 1], color="0.5", lw=1.2, ls=DASHED, label="as predicted")
    for place, (binning, (says, marker)) in enumerate(BINS.items()):
        bins = reliability[binning]
        predicted, observed = (np.array([each[key] for each in bins]) for key in ("predicted", "observed"))
        low, high = np.array([each["wilson95"] for each in bins]).T
        error = np.maximum([observed - low, high - observed], 0.0)
        style: dict[str, Any] = {"fmt": marker, "ms": 6, "capsize": 2, "lw": 1.2, "mfc": "white" if place else None}
        axes.errorbar(predicted, observed, yerr=error, color=COLOURS[place], label=f"{says}, 95 % (Wilson)", **style)
    axes.set_xlim(-0.02, 1.02)
    axes.set_ylim(-0.02, 1.02)
    axes.set_ylabel("share that was so")
    axes.grid(color="0.92")


def _draw_numbers(axes: Axes, bins: Sequence[dict[str, Any]]) -> None:
    """How many predictions there are in each bin of equal width."""
    edges = [min(int(10 * each["predicted"]), 9) / 10 for each in bins]
    axes.bar(edges, [each["n"] for each in bins], 0.1, align="edge", color=COLOURS[0], edgecolor="white", lw=0.8)
    axes.yaxis.set_major_locator(MaxNLocator(3, integer=True))
    axes.set_xlabel("predicted probability")
    axes.set_ylabel("number")


def unknown_roc(report: Report) -> Figure | None:
    """The ROC of the final probability of none of the candidates; None where no tasks of both kinds were told."""
    summaries = {method: s for method, s in report.summaries().items() if s["unknown_auc"] is not None}
    if not summaries:
        return None
    figure = Figure(figsize=(7.5, 7.6 + 0.25 * len(summaries)), dpi=DPI, layout="constrained", facecolor="white")
    axes = figure.add_subplot()
    for place, (method, summary) in enumerate(summaries.items()):
        false, true = roc_curve(*unknown_probabilities(report.of(method))).T
        low, high = summary["unknown_auc_bootstrap95"]
        label = f"{short_name(method, 40)}: AUC {summary['unknown_auc']:.3f} ({low:.3f} - {high:.3f})"
        axes.plot(false, true, label=plain(label), **line_style(place))
        known, unknown = (np.array(each) >= CONFIDENCE for each in unknown_probabilities(report.of(method)))
        says = f"at a probability of {CONFIDENCE:g}" if not place else None
        axes.plot([known.mean()], [unknown.mean()], "o", color=RED, ms=8, mfc="white", label=says, clip_on=False)
    axes.plot([0, 1], [0, 1], color="0.5", lw=1.2, ls=DASHED, label="by chance")
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.0)
    axes.set_aspect("equal")
    axes.set_xlabel("share of the known objects that would be called unknown")
    axes.set_ylabel("share of the unknown objects that would be noticed")
    axes.grid(color="0.92")
    axes.legend(loc="lower right", frameon=False, fontsize=10)
    headline(figure, "How unknown objects stand out, at the last look")
    return figure
