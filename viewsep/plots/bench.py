"""Pictures of an experiment: how poses converge and how exact they are, who separates right and at what cost.

The panels of the paper's Fig. 6, and what its section V gives as numbers. All runs count, failed ones too.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from viewsep.bench.journal import Row
from viewsep.bench.report import Report
from viewsep.bench.summary import NODE_SPACING_DEG
from viewsep.errors import BadInput
from viewsep.interpretation.interpreter import Alignment, PathOptions
from viewsep.messages import FloatArray, Phase
from viewsep.plots.answers import failures, outcomes, plain
from viewsep.plots.contact_sheet import short_name, write_png
from viewsep.plots.panels import SHADES
from viewsep.plots.sphere import RED

Draw = Callable[[Report], Figure | None]

DPI = 100
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "black")
STYLES = ("-", "--", "-.", (0, (1, 1)), (0, (5, 1, 1, 1, 1, 1)), (0, (3, 3)))
DASHED, DOTTED = (0, (6, 3)), (0, (1, 2))
ALIGNMENTS = {
    "fig4": "paths aligned by start and end (the paper's Fig. 4)",
    "wahba": "paths aligned as a whole (Wahba's fit)",
}
PAPER_COMPARISONS = 14  # in one iteration, once the hypotheses have converged (section V.C)
LARGEST_VARIANCE = 180.0**2  # of rotation vectors, deg²
ERROR_TICKS_DEG = (0.5, 1, 2, 5, 10, 20, 45, 90, 180)


def draw_pose(report: Report, folder: Path) -> list[Path]:
    """Write `convergence.png`, `pose_error.png` and `comparisons.png` of a pose experiment into `folder`.

    Returns what was written. The folder is made where it is missing; raises BadInput where that is impossible.
    """
    pictures = {"convergence": convergence, "pose_error": pose_errors, "comparisons": pose_comparisons}
    return write_pictures(report, folder, pictures)


def draw_separation(report: Report, folder: Path) -> list[Path]:
    """Write `outcomes.png`, `failures.png`, `comparisons.png` and `path_rating.png` of a separation experiment.

    Those there is nothing for are left out: `path_rating` needs a task that was done right, `comparisons` one that was
    carried out. Returns what was written. The folder is made where it is missing; raises BadInput where that is
    impossible.
    """
    pictures: dict[str, Draw] = {"outcomes": outcomes, "failures": failures}
    return write_pictures(
        report, folder, pictures | {"comparisons": separation_comparisons, "path_rating": path_rating}
    )


def make_folder(folder: Path) -> None:
    """Make the folder for the pictures where it is missing. Raises BadInput where that is impossible."""
    if folder.exists() and not folder.is_dir():
        raise BadInput(f"the pictures cannot go into {folder}: it is a file; name a folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        remedy = "choose another place"
        raise BadInput(f"cannot make the folder {folder} for the pictures: {error.strerror}; {remedy}") from error


def write_pictures(report: Report, folder: Path, pictures: Mapping[str, Draw]) -> list[Path]:
    """Draw the pictures by name, without those there is nothing for. Raises BadInput."""
    make_folder(folder)
    written = []
    for name, draw in pictures.items():
        figure = draw(report)
        if figure is not None:
            write_png(figure, folder / f"{name}.png")
            written.append(folder / f"{name}.png")
    return written


def over_iterations(rows: Sequence[Row], key: str, unknown: float = np.nan) -> list[FloatArray]:
    """What the rows' courses say of each iteration: one array a time, of the runs that got that far.

    None becomes `unknown`. Rows without a course are left out; they have no iterations to speak of.
    """
    courses = [row["course"][key] for row in rows if row.get("course")]
    longest = max(map(len, courses), default=0)
    return [
        np.array([unknown if course[i] is None else course[i] for course in courses if len(course) > i], np.float64)
        for i in range(longest)
    ]


# Poses


def convergence(report: Report) -> Figure:
    """The running variance over the iterations (Fig. 6a): medians and quartiles, an infinite one above all others."""
    configured = report.about["config"]["interpreter"]["options"].get("converged_below_deg2", 0.0)
    figure, panels = _panels(report)
    panels[0][0].set_yscale("log")
    lowest = np.inf
    for axes, methods in panels:
        for place, (variant, method) in enumerate(methods.items()):
            rows = report.of(method)
            variances = over_iterations(rows, "variance_deg2", np.inf)
            iterations = np.arange(1, len(variances) + 1)
            median = np.array([np.median(variance) for variance in variances])
            low, high = (_quantiles(variances, q) for q in (0.25, 0.75))
            high = np.minimum(high, 10.0 * LARGEST_VARIANCE)  # infinite: out of the picture
            shade, finite = line_style(place)["color"], np.isfinite(low)
            axes.fill_between(iterations, low, high, where=finite.tolist(), color=shade, alpha=0.13, lw=0)
            converged = sum(row["verdict"] != "failed" for row in rows)
            drawn = np.where(np.isfinite(median), median, np.nan)
            label = f"{variant}: {converged} of {len(rows)} converged"
            label += ", never finite" if np.isnan(drawn).all() else ""
            axes.plot(iterations, drawn, label=plain(label), **line_style(place))
            lowest = min([lowest, *low[finite & (low > 0.0)]])
            axes.set_xlim(0.0, max(len(variances) + 1.0, axes.get_xlim()[1]))
        bound = _limit(next(iter(methods.values())), configured)
        lowest = min(lowest, bound)
        axes.axhline(bound, color="black", lw=1.2, ls=DASHED, label=f"converged below {bound:g} deg²")
        _legend_below(axes, axes.get_lines(), 2)
        _name_axes(axes, "running variance of the pose (deg²)")
    panels[0][0].set_ylim(max(0.5 * lowest, 1e-3), 2.0 * LARGEST_VARIANCE)
    headline(figure, f"How fast the pose settles: median of {_runs(report)}, quartiles shaded")
    return figure


def _limit(method: str, configured_deg2: float) -> float:
    """Below which running variance the method's poses count as converged, in square degrees."""
    alignment: Alignment = "wahba" if _alignment(method) == "wahba" else "fig4"
    return PathOptions(alignment=alignment, converged_below_deg2=configured_deg2).variance_limit_deg2


def _quantiles(values: Sequence[FloatArray], q: float) -> FloatArray:
    """The quantile of each array as one of its own values: between infinite ones there is no interpolation."""
    return np.array([np.quantile(each, q, method="inverted_cdf") for each in values])


def pose_errors(report: Report) -> Figure:
    """The distribution of the pose errors per method, failed runs at their last estimate (section V.A)."""
    figure = Figure(figsize=(13.0, 6.5), dpi=DPI, layout="constrained", facecolor="white")
    axes = figure.add_subplot()
    variants, alignments = (list(dict.fromkeys(map(part, report.methods))) for part in (_variant, _alignment))
    spacing = f"node spacing of the models: {NODE_SPACING_DEG}°"
    axes.axvline(NODE_SPACING_DEG, color=RED, lw=1.4, ls=DOTTED, label=spacing)
    for method, summary in report.summaries().items():
        errors = sorted(row["pose_error_deg"] for row in report.of(method) if row.get("pose_error_deg") is not None)
        shares = np.arange(len(errors) + 1) / summary["n"]
        mean = summary["pose_error_deg_mean"]
        says = f"{method.replace('_', ' ')}: " + ("no error known" if mean is None else f"mean {mean:.1f}°")
        says += f", {summary['failed']} failed" if summary["failed"] else ""
        style = line_style(variants.index(_variant(method))) | {"ls": STYLES[alignments.index(_alignment(method))]}
        ends = [0.0, *errors, 360.0], [*shares, shares[-1]]
        axes.plot(*ends, drawstyle="steps-post", label=plain(says), **style)
    axes.set_xscale("log")
    axes.set_xlim(ERROR_TICKS_DEG[0], ERROR_TICKS_DEG[-1])
    axes.set_xticks(ERROR_TICKS_DEG, [f"{tick:g}" for tick in ERROR_TICKS_DEG])
    axes.minorticks_off()
    axes.set_ylim(0.0, 1.02)
    axes.set_xlabel("pose error (degrees)")
    axes.set_ylabel("share of the runs with at most this error")
    axes.grid(color="0.92")
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=10)
    headline(figure, f"How exact the poses are: {_runs(report)}, failed ones at their last estimate")
    return figure


def pose_comparisons(report: Report) -> Figure:
    """Feature comparisons per iteration, mean over the runs (Fig. 6c)."""
    figure, panels = _panels(report)
    for axes, methods in panels:
        for place, (variant, method) in enumerate(methods.items()):
            _draw_means(axes, over_iterations(report.of(method), "comparisons"), place, variant)
        _cost_landmarks(axes, report)
        _legend_below(axes, axes.get_lines(), 2)
        _name_axes(axes, "feature comparisons per iteration")
    headline(figure, f"What a look costs: feature comparisons, mean of {_runs(report)}")
    return figure


def _panels(report: Report) -> tuple[Figure, list[tuple[Axes, dict[str, str]]]]:
    """A panel for each alignment, with its methods by variant; all panels have the same scales."""
    alignments = list(dict.fromkeys(map(_alignment, report.methods)))
    figure = Figure(figsize=(max(7.5 * len(alignments), 9.0), 6.2), dpi=DPI, layout="constrained", facecolor="white")
    grid = figure.subplots(1, len(alignments), sharex=True, sharey=True, squeeze=False)
    panels = []
    for axes, alignment in zip(grid[0], alignments, strict=True):
        axes.set_title(plain(ALIGNMENTS.get(alignment, alignment)), size=11, loc="left")
        mine = [method for method in report.methods if _alignment(method) == alignment]
        panels.append((axes, {_variant(method).replace("_", " "): method for method in mine}))
    return figure, panels


def _variant(method: str) -> str:
    return method.partition(", ")[0]


def _alignment(method: str) -> str:
    return method.partition(", ")[2]


def _runs(report: Report) -> str:
    runs = len(report.of(report.methods[0]))
    return f"{runs} run{'s' if runs != 1 else ''}"


# Separations


def separation_comparisons(report: Report) -> Figure | None:
    """Feature comparisons per candidate in every iteration, mean of the tasks still running (Fig. 6c).

    None when no task was carried out by a method that iterates.
    """
    courses = {method: over_iterations(report.of(method), "comparisons") for method in report.methods}
    courses = {method: course for method, course in courses.items() if course}
    if not courses:
        return None
    figure = Figure(figsize=(11.0, 7.5), dpi=DPI, layout="constrained", facecolor="white")
    axes, running = figure.subplots(2, 1, sharex=True, height_ratios=(4, 1))
    for place, (method, course) in enumerate(courses.items()):
        counts = [len(values) for values in course]
        _draw_means(axes, course, place, f"{short_name(method, 40)} (n = {counts[0]})")
        running.step(np.arange(1, len(counts) + 1), counts, where="mid", **line_style(place) | {"lw": 1.2})
    _cost_landmarks(axes, report)
    _name_axes(axes, "feature comparisons per candidate")
    _name_axes(running, "tasks running")
    running.set_ylim(bottom=0)
    running.yaxis.set_major_locator(MaxNLocator(3, integer=True))
    _legend_below(running, axes.get_lines(), 3, -0.4)
    headline(figure, "What a look costs: feature comparisons per candidate, mean of the tasks still running")
    return figure


def path_rating(report: Report) -> Figure | None:
    """w1 of truth and rival over the iterations of the main method's first right task (Fig. 6b); None without one."""
    main = report.methods[0]
    rows = report.of(main)
    row = next((row for row in rows if row["verdict"] == "right" and _has_both_courses(row)), None)
    if row is None:
        return None
    course, truth = row["course"], row["truth"]
    figure = Figure(figsize=(10.0, 6.0), dpi=DPI, layout="constrained", facecolor="white")
    axes = figure.add_subplot()
    handles: list[Artist] = []
    for name in sorted(course["w1_deg"], key=lambda name: name != truth):
        true = name == truth
        colour, dashes, marker = (COLOURS[0], "-", "o") if true else (RED, "--", "s")
        style: dict[str, Any] = {"color": colour, "ls": dashes, "lw": 1.6, "marker": marker, "ms": 3.5}
        w1 = np.array(course["w1_deg"][name], np.float64)  # None becomes nan
        label = plain(f"{'truth' if true else 'rival'}: {short_name(name, 40)}")
        handles += axes.plot(np.arange(1, len(w1) + 1), w1, label=label, **style)
    begin = 0.5
    for phase, looks in groupby(course["phase"]):
        end = begin + len(list(looks))
        axes.axvspan(begin, end, color=SHADES.get(Phase(phase), "1.0"), lw=0, zorder=0)
        begin = end
    shown = [phase for phase in SHADES if phase in course["phase"]]
    handles += [Patch(fc=SHADES[phase], ec="0.6", lw=0.6, label=phase.value) for phase in shown]
    _name_axes(axes, "path course w1 of the best hypothesis (degrees)")
    axes.grid(visible=False)
    axes.set_xlim(0.5, begin)
    axes.set_ylim(bottom=0.0)
    _legend_below(axes, handles, 3)
    axes.set_title(plain(f"{main}, task {row['index'] + 1} of {len(rows)} (seed {row['seed']})"), size=11, loc="left")
    headline(figure, "How well the best paths of truth and rival fit: the first task that was done right")
    return figure


def _has_both_courses(row: Row) -> bool:
    courses: dict[str, list[float | None]] = (row.get("course") or {}).get("w1_deg", {})
    known = [any(value is not None for value in course) for course in courses.values()]
    return row["truth"] in courses and known == [True, True]


# Both


def line_style(place: int) -> dict[str, Any]:
    """What sets a line apart from the others: colour and dashes."""
    return {"color": COLOURS[place % len(COLOURS)], "ls": STYLES[place % len(STYLES)], "lw": 2.0}


def _draw_means(axes: Axes, course: Sequence[FloatArray], place: int, label: str) -> None:
    means = [float(values.mean()) for values in course]
    axes.plot(np.arange(1, len(means) + 1), means, label=plain(label), **line_style(place))


def _cost_landmarks(axes: Axes, report: Report) -> None:
    """Brute force, which compares every view, and what the paper reached."""
    views = report.about.get("views")
    if views is not None:
        axes.axhline(views, color=RED, lw=1.4, ls=DASHED, label=f"brute force: all {views} views")
    says = f"the paper's {PAPER_COMPARISONS}, once converged"
    axes.axhline(PAPER_COMPARISONS, color="0.35", lw=1.4, ls=DOTTED, label=says)
    axes.set_ylim(0.0, max(1.1 * (views or 0), axes.get_ylim()[1]))


def _name_axes(axes: Axes, quantity: str) -> None:
    """Iterations to the right; inner panels share the labels of the outer ones."""
    axes.set_xlabel("iteration")
    axes.set_ylabel(quantity)
    axes.label_outer()
    axes.grid(color="0.92")
    axes.xaxis.set_major_locator(MaxNLocator("auto", integer=True, steps=[1, 2, 5, 10]))


def _legend_below(axes: Axes, handles: Sequence[Artist], columns: int, below: float = -0.1) -> None:
    """Outside, where it covers nothing."""
    at = (0.5, below)
    axes.legend(handles=handles, loc="upper center", bbox_to_anchor=at, ncols=columns, frameon=False, fontsize=10)


def headline(figure: Figure, text: str) -> None:
    """What a picture is about, over all of it."""
    figure.suptitle(text, size=14, weight="bold", x=0.01, ha="left")
