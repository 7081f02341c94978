"""Pictures of the answers in a separation experiment: how many are right per method, and which objects are mistaken."""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from textwrap import wrap
from typing import Any, TypeVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.patheffects import withStroke

from viewsep.bench.journal import Row
from viewsep.bench.report import Report
from viewsep.messages import Array, FloatArray
from viewsep.plots.contact_sheet import short_name

DPI = 100
COLOURS = {
    "right": "#0072B2",
    "indistinguishable": "#009E73",
    "unknown": "#CC79A7",
    "undecided": "#E69F00",
    "failed": "0.45",
    "wrong": "#D55E00",
}
"""The verdicts in the order they are drawn in: wrong is last, so that both it and right have an edge."""
ALWAYS = ("right", "undecided", "failed", "wrong")
PALE = "#BFDBEC"  # a quarter of the colour of right, for what needs no attention
OTHER = "other objects"
NAME = 34  # letters of a name
MOST = 40  # rows of a heat map, and objects above it
WIDEST_IN, NARROWEST_IN, TALLEST_IN = 16.0, 9.0, 9.6
CELL_IN, TITLE_IN, MARGIN_IN = 0.42, 1.15, 0.2
LETTER_IN, BOLD_LETTER_IN = 0.078, 0.095
LUMINANCE = np.array([0.299, 0.587, 0.114])

Key = TypeVar("Key", bound=Hashable)
_Column = tuple[float, str, str]
"""Width in inches, heading, text."""


def plain(text: str) -> str:
    """The text as it is written: dollars in a name make no formula of it."""
    return text.replace("$", r"\$")


# Shares


def outcomes(report: Report) -> Figure:
    """A bar per method, with the shares of its tasks that went right, wrong, and neither."""
    labels, summaries = [short_name(method, NAME) for method in report.methods], list(report.summaries().values())
    left = MARGIN_IN + 1.3 * LETTER_IN * max(map(len, labels))
    occurring = {row["verdict"] for row in report.rows}
    kinds = [kind for kind in COLOURS if kind in occurring or kind in ALWAYS]
    beside = MARGIN_IN + sum(room for room, _, _ in _columns(summaries[0], kinds))
    bars = min(7.2, WIDEST_IN - left - beside)
    size = (left + bars + beside, 1.75 + 0.55 * len(labels))
    figure, axes = _page(size, (left, 0.6, bars, size[1] - 1.75))
    for place, summary in enumerate(summaries):
        begin = 0.0
        for kind in COLOURS:
            share = summary[kind] / summary["n"]
            axes.barh(place, share, 0.66, left=begin, color=COLOURS[kind], edgecolor="white", lw=0.8, label=kind)
            begin += share
        low, high = summary["right_wilson95"]
        _interval(axes, low, high, place - 0.12)
        low, high = summary["wrong_wilson95"]
        _interval(axes, 1.0 - high, 1.0 - low, place + 0.12)
        _figures(axes, place, _columns(summary, kinds), bars)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(len(labels) - 0.5, -0.5)
    axes.set_xticks(np.linspace(0.0, 1.0, 6), [f"{percent} %" for percent in range(0, 101, 20)])
    axes.set_yticks(range(len(labels)), [plain(label) for label in labels], size=11)
    axes.set_xlabel("share of the tasks")
    axes.tick_params(axis="y", length=0)
    axes.spines[["top", "right", "left"]].set_visible(False)
    facts = "lines: 95 % intervals (Wilson) of right, measured from the left, and of wrong, measured from the right"
    _title(figure, f"Which method separates right: {_tasks(len(report.of(report.methods[0])))} for each", facts)
    _legend(figure, occurring, COLOURS)
    return figure


def _columns(summary: dict[str, Any], kinds: Sequence[str]) -> list[_Column]:
    """The figures beside a bar: right and wrong, how often each of the other `kinds` came out, all tasks."""
    columns: list[_Column] = []
    for kind in ("right", "wrong"):
        columns += [(0.65, kind, str(summary[kind])), (1.0, "95 %", _percent(summary[f"{kind}_wilson95"]))]
    others = [kind for kind in kinds if kind not in ("right", "wrong")]
    columns += [(0.25 + LETTER_IN * len(kind), kind, str(summary[kind])) for kind in others]
    return [*columns, (0.5, "of", str(summary["n"]))]


def _interval(axes: Axes, low: float, high: float, y: float) -> None:
    line = axes.errorbar([(low + high) / 2], [y], xerr=(high - low) / 2, color="black", lw=1.4, capsize=3, fmt="none")
    for artist in line.get_children():
        artist.set_path_effects([withStroke(linewidth=3.2, foreground="white")])


def _figures(axes: Axes, place: int, columns: Sequence[_Column], width: float) -> None:
    """The numbers beside a bar that ends at `width` inches, under headings over the first one."""
    style: dict[str, Any] = {"transform": axes.get_yaxis_transform(), "ha": "right", "va": "center"}
    inches = 0.0
    for room, heading, text in columns:
        inches += room
        x = 1.0 + inches / width
        axes.text(x, place, text, size=11, **style)
        if place == 0:
            axes.text(x, -0.62, heading, size=9.5, color="0.35", **style)


def _percent(interval: Sequence[float]) -> str:
    return f"{100 * interval[0]:.0f} - {100 * interval[1]:.0f} %"


# Heat maps


@dataclass(frozen=True, eq=False, slots=True)
class Answers:
    """Counted answers: `counts` (R, C), their `kinds` (R, C), and the tasks (R, C) that each count is a share of.

    `groups` are headings over so many columns each; `hidden` rows had fewer failures than those shown.
    """

    rows: list[str]
    columns: list[str]
    groups: list[tuple[str, int]]
    counts: Array
    kinds: Array
    tasks: Array
    hidden: int


def confusions(rows: Sequence[Row]) -> Answers:
    """One method's answers: a row per object that was held, a column per object that was named, or what else came out.

    An object that was held without being a candidate has a row of its own. Of many objects those with the most failures
    are shown, and names that belong to none of them are counted together.
    """
    held = [(row["truth"], not row.get("known", True)) for row in rows]
    shown, hidden = _most_failed(held, rows)
    kept = [(truth, row) for truth, row in zip(held, rows, strict=True) if truth in shown]
    named = {row["object"] for _, row in kept if row["outcome"] == "identified"}
    rare = named - {truth for truth, _ in shown} if len(named) > MOST else set()
    endings = sorted({row["outcome"] for _, row in kept if row["outcome"] != "identified"})
    columns = [(True, name) for name in sorted(named - rare)] + [(True, OTHER)] * bool(rare)
    objects = len(columns)
    columns += [(False, ending) for ending in endings]
    counts = np.zeros((len(shown), len(columns)), np.int64)
    kinds = np.full(counts.shape, "right", object)
    for truth, row in kept:
        identified = row["outcome"] == "identified"
        said = row["object"] if identified else row["outcome"]
        cell = shown.index(truth), columns.index((identified, OTHER if identified and said in rare else said))
        counts[cell] += 1
        kinds[cell] = row["verdict"]
    return Answers(
        rows=[short_name(truth, NAME) + " (no candidate)" * alien for truth, alien in shown],
        columns=[short_name(said, NAME) for _, said in columns],
        groups=[("object that was named", objects), ("none named", len(endings))],
        counts=counts,
        kinds=kinds,
        tasks=np.repeat(counts.sum(axis=1, keepdims=True), len(columns), axis=1),
        hidden=hidden,
    )


def pair_answers(report: Report) -> Answers:
    """All methods' answers per pair of candidates: under each method how many were right, undecided, failed, wrong."""
    main = report.of(report.methods[0])
    shown, hidden = _most_failed([tuple(row["candidates"]) for row in main], main)
    occurring = {row["verdict"] for row in report.rows}
    kinds = [kind for kind in COLOURS if kind in occurring or kind in ("right", "wrong")]
    tally = Counter((tuple(row["candidates"]), row["method"], row["verdict"]) for row in report.rows)
    counts = np.array([[[tally[pair, method, kind] for kind in kinds] for method in report.methods] for pair in shown])
    tasks = np.broadcast_to(counts.sum(axis=2, keepdims=True), counts.shape)
    flat = (len(shown), len(report.methods) * len(kinds))
    return Answers(
        rows=[" / ".join(short_name(name, 28) for name in pair) for pair in shown],
        columns=kinds * len(report.methods),
        groups=[(method, len(kinds)) for method in report.methods],
        counts=counts.reshape(flat),
        kinds=np.tile(np.array(kinds, object), (len(shown), len(report.methods))),
        tasks=tasks.reshape(flat),
        hidden=hidden,
    )


def are_pairs(rows: Sequence[Row]) -> bool:
    """Whether look-alikes were separated in fixed pairs: always two candidates, and no more pairs than objects."""
    pairs = {tuple(row["candidates"]) for row in rows}
    objects = {name for pair in pairs for name in pair}
    known = all(row.get("known", True) for row in rows)
    return known and all(len(pair) == 2 for pair in pairs) and len(pairs) <= len(objects)


def failures(report: Report) -> Figure:
    """A heat map of the answers: per pair and method for look-alikes in pairs, else the main method's confusions."""
    main = report.methods[0]
    rows = report.of(main)
    if are_pairs(rows):
        answers = pair_answers(report)
        title, facts = "Which pairs are mistaken", f"{_tasks(len(rows))} for each method"
    else:
        answers = confusions(rows)
        right = sum(row["verdict"] == "right" for row in rows)
        title, facts = "Which objects are mistaken", f"{short_name(main, 40)}: {right} right of {_tasks(len(rows))}"
    if answers.hidden:
        facts += f"; the {len(answers.rows)} of {len(answers.rows) + answers.hidden} rows with the most failures"
    figure = _heat_map(answers)
    _title(figure, title, f"{facts}; numbers are tasks, deeper colours larger shares of a row")
    _legend(figure, set(answers.kinds[answers.counts > 0]), COLOURS | {"right": PALE})
    return figure


def _heat_map(answers: Answers) -> Figure:
    count, columns = answers.counts.shape
    left = MARGIN_IN + LETTER_IN * max(map(len, answers.rows))
    top = TITLE_IN + 0.35 + LETTER_IN * max(map(len, answers.columns))
    cell = min(CELL_IN, (WIDEST_IN - left - MARGIN_IN) / columns)
    height = count * min(CELL_IN, max(0.24, TALLEST_IN / count))
    size = (max(NARROWEST_IN, left + columns * cell + MARGIN_IN), top + height + MARGIN_IN)
    figure, axes = _page(size, (left, MARGIN_IN, columns * cell, height))
    colours = _cell_colours(answers)
    axes.imshow(colours, aspect="auto", interpolation="nearest")
    axes.set_xticks(range(columns), [plain(label) for label in answers.columns], rotation=90, size=9)
    axes.set_yticks(range(count), [plain(label) for label in answers.rows], size=9)
    axes.tick_params(length=0, top=False, labeltop=True, labelbottom=False)
    axes.set_xticks(np.arange(columns + 1) - 0.5, minor=True)
    axes.set_yticks(np.arange(count + 1) - 0.5, minor=True)
    axes.grid(which="minor", color="0.9", lw=0.6)
    axes.tick_params(which="minor", length=0)
    for i, j in np.argwhere(answers.counts > 0):
        weight = "normal" if answers.kinds[i, j] == "right" else "bold"
        ink = "black" if colours[i, j] @ LUMINANCE > 0.5 else "white"
        axes.text(j, i, str(answers.counts[i, j]), ha="center", va="center", size=9, weight=weight, color=ink)
    _head_groups(axes, answers.groups, cell, 1.0 + (top - TITLE_IN - 0.15) / height)
    return figure


def _head_groups(axes: Axes, groups: Sequence[tuple[str, int]], cell: float, y: float) -> None:
    """Lines between groups of columns and, where there is room, headings over them; a column is `cell` inches wide."""
    begin = 0
    for heading, width in groups:
        if begin:
            axes.axvline(begin - 0.5, color="0.2", lw=1.4)
        letters = int(width * cell / BOLD_LETTER_IN) if len(groups) > 1 else NAME
        if letters >= min(8, len(heading)):
            style: dict[str, Any] = {"ha": "center", "va": "center", "size": 9, "weight": "bold"}
            text = plain("\n".join(wrap(heading, letters, max_lines=2, placeholder=" …")))
            axes.text(begin + (width - 1) / 2, y, text, transform=axes.get_xaxis_transform(), **style)
        begin += width


def _cell_colours(answers: Answers) -> FloatArray:
    """(R, C, 3): white where nothing was counted, right answers pale, all others strong."""
    share = answers.counts / np.maximum(answers.tasks, 1)
    depth = np.where(answers.kinds == "right", 0.1 + 0.15 * share, 0.3 + 0.7 * share) * (answers.counts > 0)
    colours = np.array([[to_rgb(COLOURS[kind]) for kind in row] for row in answers.kinds])
    mixed: FloatArray = 1.0 - depth[..., None] * (1.0 - colours)
    return mixed


def _most_failed(keys: Sequence[Key], rows: Sequence[Row]) -> tuple[list[Key], int]:
    """The keys of the rows, in order, without those with the fewest failures where they are too many; and how many."""
    failed = Counter(key for key, row in zip(keys, rows, strict=True) if row["verdict"] != "right")
    found: list[Any] = sorted(set(keys))
    shown = sorted(sorted(found, key=lambda key: -failed[key])[:MOST])
    return shown, len(found) - len(shown)


# Page


def _page(size: tuple[float, float], box: tuple[float, float, float, float]) -> tuple[Figure, Axes]:
    """A figure of about that size and axes at (left, bottom, width, height), all in inches."""
    width, height = (round(DPI * inches) / DPI for inches in size)  # whole pixels
    figure = Figure(figsize=(width, height), dpi=DPI, facecolor="white")
    return figure, figure.add_axes((box[0] / width, box[1] / height, box[2] / width, box[3] / height))


def _title(figure: Figure, title: str, facts: str) -> None:
    inch_x, inch_y = 1.0 / figure.get_figwidth(), 1.0 / figure.get_figheight()
    figure.text(0.15 * inch_x, 1.0 - 0.12 * inch_y, title, size=14, weight="bold", va="top")
    figure.text(0.15 * inch_x, 1.0 - 0.46 * inch_y, plain(facts), size=10, color="0.25", va="top")


def _legend(figure: Figure, kinds: set[str], colours: Mapping[str, str]) -> None:
    at = (0.07 / figure.get_figwidth(), 1.0 - 0.66 / figure.get_figheight())
    handles = [Patch(fc=colours[kind], label=kind) for kind in COLOURS if kind in kinds]
    figure.legend(handles=handles, loc="upper left", bbox_to_anchor=at, ncols=len(handles), frameon=False, fontsize=10)


def _tasks(count: int) -> str:
    return f"{count} task{'s' if count != 1 else ''}"
