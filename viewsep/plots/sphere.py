"""A view sphere on paper: an orthographic look at the unit sphere, with its nodes, values and paths.

Everything is given in the control frame. What lies behind the sphere is drawn faintly or left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from scipy.spatial import cKDTree

from viewsep.geometry import delaunay_edges, great_circle, perpendicular, unit
from viewsep.messages import Array, FloatArray

RED = "#D55E00"  # the paper's controlled path; all colours are Okabe and Ito's, for any kind of sight
YELLOW = "#F0E442"
VALUES = colormaps["cividis"]
RASTER_PX = 320
ARC_STEP_RAD = float(np.radians(3.0))
MIN_TILT_RAD = float(np.radians(25.0))  # paths at the viewer's own height would be seen edge-on, as a straight line
FAINT = 0.3  # opacity of what lies behind the sphere
OUTLINE = "0.45"
LONG = 100  # looks; longer paths are drawn thinner
MOST_NUMBERS = 6  # more separating views than these stay without numbers


@dataclass(frozen=True, eq=False, slots=True)
class SphereView:
    """Where the viewer stands: the rows of `axes` (3, 3) point right, up and towards the viewer."""

    axes: FloatArray

    @staticmethod
    def facing(directions: FloatArray) -> SphereView:
        """A view of the side most of the directions (N, 3) lie on, the control frame's z axis up."""
        mean = directions.sum(axis=0) if len(directions) else np.ones(3)
        towards = unit(mean) if np.linalg.norm(mean) > 1e-6 else perpendicular(directions[0])
        flat = np.hypot(towards[0], towards[1])
        if abs(towards[2]) < np.sin(MIN_TILT_RAD):
            raised = np.copysign(np.sin(MIN_TILT_RAD), towards[2])
            towards = np.array([*(towards[:2] * np.cos(MIN_TILT_RAD) / flat), raised])
        right = unit(np.array([-towards[1], towards[0], 0.0])) if flat > 1e-9 else np.array([0.0, 1.0, 0.0])
        return SphereView(np.stack([right, np.cross(towards, right), towards]))

    def from_behind(self) -> SphereView:
        """The view of the other half, from the opposite point, with the same axis up."""
        return SphereView(self.axes * np.array([[-1.0], [1.0], [-1.0]]))

    def project(self, directions: FloatArray) -> tuple[FloatArray, Array]:
        """Directions (N, 3) -> positions on the paper (N, 2) and (N,) True on the visible half."""
        seen = directions @ self.axes.T
        return seen[:, :2], seen[:, 2] >= 0.0


def draw_globe(axes: Axes, view: SphereView, *, name: str = "") -> None:
    """The outline of the sphere and, in a corner, the control frame's axes as the viewer sees them.

    `name` says which side it is.
    """
    axes.set_aspect("equal")
    axes.set_axis_off()
    axes.set_xlim(-1.09, 1.09)
    axes.set_ylim(-1.09, 1.09)
    axes.text(1.0, -1.04, name, size=9.5, color=OUTLINE, ha="right")
    axes.add_patch(Circle((0, 0), 1.0, facecolor="0.975", edgecolor=OUTLINE, lw=1.0, zorder=0.3))
    corner = np.array([-0.88, -0.88])
    tips, _ = view.project(np.eye(3))
    for tip, name in zip(tips, "xyz", strict=True):
        axes.plot(*np.stack([corner, corner + 0.13 * tip], axis=1), color=OUTLINE, lw=1.2, solid_capstyle="round")
        if np.linalg.norm(tip) > 0.25:
            x, y = corner + 0.13 * tip + 0.06 * unit(tip)
            axes.text(x, y, name, size=8, color=OUTLINE, ha="center", va="center")


def draw_graph(axes: Axes, view: SphereView, directions: FloatArray, edges: Array, *, colour: str = "0.72") -> None:
    """The visible nodes (N, 3) of an aspect graph and the edges (E, 2) between them."""
    at, front = view.project(directions)
    shown = edges[front[edges].all(axis=1)]
    axes.add_collection(LineCollection(list(at[shown]), colors=colour, linewidths=0.4, zorder=1.0))
    axes.plot(*at[front].T, ".", color=colour, ms=3.5, zorder=1.1)


def draw_values(axes: Axes, view: SphereView, directions: FloatArray, values: FloatArray, norm: Normalize) -> None:
    """Every point of the visible half in the colour of its nearest node's value (N,), and the graph (Fig. 5a)."""
    line = np.linspace(-1.0, 1.0, RASTER_PX)
    x, y = np.meshgrid(line, line)
    inside = x * x + y * y <= 1.0
    seen = np.stack([x, y, np.sqrt(np.clip(1.0 - x * x - y * y, 0.0, None))], axis=-1)[inside]
    raster = np.full(inside.shape, np.nan)
    raster[inside] = values[cKDTree(directions).query(seen @ view.axes)[1]]
    picture = axes.imshow(raster, origin="lower", extent=(-1, 1, -1, 1), norm=norm, cmap=VALUES, zorder=0.4)
    picture.set_clip_path(Circle((0, 0), 1.0, transform=axes.transData))
    draw_graph(axes, view, directions, delaunay_edges(directions), colour="0.8")


def draw_path(
    axes: Axes,
    view: SphereView,
    directions: FloatArray,
    *,
    colour: str,
    width: float,
    alpha: float = 1.0,
    behind: float = 0.0,
    order: float = 2.0,
) -> None:
    """Arcs through the directions (N, 3); the hidden part with `behind` times the opacity, left out at 0."""
    points = along_arcs(directions)
    at, front = view.project(points)
    for part, strength, below in ((front, 1.0, 0.0), (~front, behind, 1.0)):
        if strength > 0.0 and part.any():
            line = np.where(part[:, None], at, np.nan)
            axes.plot(*line.T, color=colour, lw=width, alpha=alpha * strength, zorder=order - below)


def draw_marks(
    axes: Axes,
    view: SphereView,
    directions: FloatArray,
    *,
    marker: str,
    colour: str,
    size: float,
    labels: Sequence[str] = (),
    behind: bool = False,
) -> None:
    """A mark at each direction (N, 3), with a label beside it; hidden ones hollow with `behind`, else left out."""
    at, front = view.project(directions)
    for i, position in enumerate(at):
        if not front[i] and not behind:
            continue
        face = colour if front[i] else "none"
        edge = "black" if front[i] else "0.55"
        axes.plot(*position, marker, mfc=face, mec=edge, mew=0.9, ms=size, zorder=6.0)
        if i < len(labels):
            offset = (0.55 * size, 0.45 * size)
            note = axes.annotate(labels[i], position, offset, textcoords="offset points", size=9, weight="bold")
            note.set(zorder=7.0, bbox={"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.75})


@dataclass(frozen=True, eq=False, slots=True)
class Landmarks:
    """What is marked on every sphere: the controlled path (H, 3) and the separating views (T, 3), in order."""

    controlled: FloatArray
    separating: FloatArray

    def draw(self, axes: Axes, view: SphereView, *, see_through: bool = False) -> None:
        """The path in red with its first and last view, the separating views as stars, numbered where several."""
        width, behind = (1.8, FAINT) if len(self.controlled) <= LONG else (1.1, 0.5 * FAINT)
        behind = behind if see_through else 0.0
        draw_path(axes, view, self.controlled, colour=RED, width=width, behind=behind, order=2.4)
        draw_marks(axes, view, self.controlled[:1], marker="o", colour="white", size=8, behind=see_through)
        draw_marks(axes, view, self.controlled[-1:], marker="s", colour=RED, size=7, behind=see_through)
        count = len(self.separating)
        labels = [str(i + 1) for i in range(count)] if 1 < count <= MOST_NUMBERS else []
        draw_marks(axes, view, self.separating, marker="*", colour=YELLOW, size=15, labels=labels, behind=see_through)


def draw_hypotheses(axes: Axes, view: SphereView, paths: Sequence[FloatArray], *, colour: str) -> None:
    """Transformed path hypotheses (H, 3), the best one first and thick, all of it (Figs. 3, 5b, 5c)."""
    for path in paths[1:]:
        draw_path(axes, view, path, colour=colour, width=1.0, alpha=0.22)
    for path in paths[:1]:
        draw_path(axes, view, path, colour=colour, width=2.6, behind=FAINT, order=2.2)


def draw_distances(axes: Axes, view: SphereView, controlled: FloatArray, path: FloatArray, *, colour: str) -> None:
    """Thin arcs from each view of the controlled path (H, 3) to the hypothesis' node (H, 3) at that hit (eq. 3)."""
    alpha = float(np.clip(20.0 / len(path), 0.15, 0.6))  # long paths would otherwise hide everything
    for pair in zip(controlled, path, strict=True):
        draw_path(axes, view, np.array(pair), colour=colour, width=0.8, alpha=alpha)


def legend(goal: str) -> list[Line2D]:
    """Handles that explain what is drawn on a candidate's sphere; `goal` is what the stars are called."""

    def mark(marker: str, colour: str, size: float, label: str) -> Line2D:
        return Line2D([], [], ls="", marker=marker, mfc=colour, mec="black", mew=0.9, ms=size, label=label)

    return [
        Line2D([], [], color=RED, lw=2, label="controlled path"),
        mark("o", "white", 8, "start view"),
        mark("s", RED, 7, "last view"),
        mark("*", YELLOW, 14, goal),
        Line2D([], [], color="0.3", lw=2.6, label="best path hypothesis"),
        Line2D([], [], color="0.3", lw=1, alpha=0.4, label="other hypotheses"),
    ]


def along_arcs(directions: FloatArray) -> FloatArray:
    """(M, 3) points at most 3° apart on the great-circle arcs through the directions (N, 3)."""
    moved = np.any(np.diff(directions, axis=0) != 0.0, axis=1)
    stops = directions[np.concatenate([[True], moved])] if len(directions) else directions
    return np.concatenate([stops[:1], *[great_circle(a, b, ARC_STEP_RAD) for a, b in pairwise(stops)]])
