"""Pictures of a checked library: how alike every two objects are, and from where the hardest pairs are told apart."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from viewsep.geometry import fibonacci_sphere
from viewsep.interpretation.view_cells import cell_of
from viewsep.library_check.pairs import Pair
from viewsep.library_check.words import pair_in_words
from viewsep.plots.contact_sheet import write_png
from viewsep.plots.sphere import VALUES, YELLOW, SphereView, draw_globe, draw_marks, draw_values

DPI = 100
HARDEST = 5  # pairs that are drawn one by one
NUMBERS = 12  # objects up to which the squares carry numbers
SHOWN = 600  # points of a sphere: about 8 degrees apart
WRAPPED = 110  # characters in a line


def draw_confusion(pairs: Sequence[Pair], names: Sequence[str], folder: Path) -> Path:
    """`confusion.png`: the bits that one look tells about every two objects. Raises BadInput."""
    count = len(names)
    place = {name: k for k, name in enumerate(names)}
    bits = np.full((count, count), np.nan)
    for pair in pairs:
        i, j = place[pair.first], place[pair.second]
        bits[i, j] = bits[j, i] = pair.bits
    side = float(np.clip(0.32 * count + 3.0, 5.0, 24.0))
    figure = Figure(figsize=(side + 1.0, side), dpi=DPI, facecolor="white", layout="constrained")
    axes = figure.add_subplot()
    picture = axes.imshow(bits, cmap=VALUES, norm=Normalize(0.0, 1.0))
    axes.set_xticks(range(count), names, rotation=90, fontsize=8)
    axes.set_yticks(range(count), names, fontsize=8)
    if count <= NUMBERS:
        for i, j in zip(*np.nonzero(np.isfinite(bits)), strict=True):
            colour = "white" if bits[i, j] < 0.5 else "black"
            axes.text(j, i, f"{bits[i, j]:.2f}", ha="center", va="center", color=colour, fontsize=8)
    axes.set_title(
        "What one look tells about two objects in the pose in which they are most alike", fontsize=9, wrap=True
    )
    figure.colorbar(picture, ax=axes, shrink=0.7, label="bits a look, on average (0: never told apart)")
    path = folder / "confusion.png"
    write_png(figure, path)
    return path


def draw_hardest(pairs: Sequence[Pair], folder: Path) -> list[Path]:
    """`NUMBER_FIRST_SECOND.png` of the hardest pairs: the first object's sphere, both sides. Raises BadInput."""
    written = []
    for number, pair in enumerate(pairs[:HARDEST], 1):
        if pair.alignment is not None:
            path = folder / f"{number}_{pair.first}_{pair.second}.png"
            write_png(_spheres(pair), path)
            written.append(path)
    return written


def _spheres(pair: Pair) -> Figure:
    assert pair.alignment is not None
    points = fibonacci_sphere(SHOWN)
    bits = pair.alignment.bits[cell_of(*points.T)]
    figure = Figure(figsize=(9.0, 5.0), dpi=DPI, facecolor="white", layout="constrained")
    front = SphereView.facing(pair.best_views[:1] if len(pair.best_views) else np.eye(3)[:1])
    norm = Normalize(0.0, 1.0)
    panels = figure.subplots(1, 2)
    for axes, view, name in zip(panels, (front, front.from_behind()), ("front", "back"), strict=True):
        draw_globe(axes, view, name=name)
        draw_values(axes, view, points, bits, norm)
        draw_marks(axes, view, pair.best_views, marker="*", colour=YELLOW, size=14)
    colours = panels[0].images[0]
    figure.colorbar(colours, ax=list(panels), shrink=0.6, label=f"bits that a look at {pair.first} tells")
    figure.suptitle(pair_in_words(pair), fontsize=9, wrap=True)
    return figure
