"""One picture of one separation task, drawn from its recording: what was seen, believed, planned and concluded."""

from __future__ import annotations

from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec, SubplotSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from viewsep.account import Account
from viewsep.config import geometry_of
from viewsep.messages import Array, Phase, Result
from viewsep.plots import panels, sphere
from viewsep.plots.contact_sheet import short_name, write_png
from viewsep.plots.panels import COLOURS, OTHERS, SHADES, SPHERES, line_style, say
from viewsep.plots.sphere import RED
from viewsep.plots.story import Story, retell
from viewsep.recordings.reader import Recording


def report(recording: Recording, path: Path) -> None:
    """Write a PNG of 1600 x 1200 pixels that tells the recorded task (the paper's Figs. 3, 5 and 6 for one run).

    Raises BadInput when `path` cannot be written, BadRecording when the recording cannot be replayed.
    """
    story = retell(recording)
    figure = Figure(figsize=(16.0, 12.0), dpi=100, facecolor="white")
    _headline(figure, story)
    columns = min(SPHERES, len(story.models) * _spheres_each(story)) if story.looks else SPHERES
    side = 0.01 + 0.1225 * (4 - columns)
    spheres = GridSpec(1, columns, figure, left=side, right=1.0 - side, top=0.88, bottom=0.575, wspace=0.02)
    middle = GridSpec(1, 2, figure, left=0.01, right=0.99, top=0.495, bottom=0.285, wspace=0.03, width_ratios=(4, 5))
    curves = GridSpec(1, 4, figure, left=0.045, right=0.99, top=0.205, bottom=0.042, wspace=0.24)
    if story.looks:
        _candidate_spheres(figure, spheres, story)
    else:
        say(figure.add_subplot(spheres[:]), "no percept was interpreted: there are no paths to show")
    _similarity(figure, middle[0], story)
    _pictures(figure, middle[1], story)
    for column, curve in enumerate(panels.curves(story)):
        axes = figure.add_subplot(curves[0, column])
        if story.looks:
            curve(axes, story)
        else:
            say(axes, "no percept")
    _curve_legend(figure, story)
    write_png(figure, path)


def _headline(figure: Figure, story: Story) -> None:
    """Outcome, object and truth; the engine's reason; looks, travel, seed and rig; whether the replay agrees."""
    result, wrong = story.result, story.correct is False
    truth = short_name(story.truth, 36)
    if result is None:
        travel = story.end.travel_rad if story.end else 0.0
        says, reason = "no result", "the recording ends before the task"
    else:
        account = Account.of(result)
        says, reason, travel = result.outcome.value, account.grounds, result.travel_rad
        reason += f"; {account.pose}" if account.pose else ""
    if result is not None and account.answer:
        verdict = f"wrong, it was {truth}" if wrong else "right" if truth else "truth not recorded"
        says += f": {short_name(account.answer, 72 if result.indistinct else 36)} ({verdict})"
    elif truth:
        says += f" (it was {truth})"
    seed, rig = story.task.get("seed", "not recorded"), story.config.rig
    facts = f"{len(story.looks)} looks · {np.degrees(travel):.0f}° of travel · seed {seed}"
    facts += f" · {len(story.models)} candidates · rig {geometry_of(rig).name}"
    facts += " · simulated rig, not a real one" if rig.backend == "sim" else ""

    def write(x: float, y: float, text: str, **style: Any) -> None:
        figure.text(x, y, shorten(text, 150, placeholder=" …"), va="top", parse_math=False, **style)

    write(0.015, 0.985, says, size=19, weight="bold", color=RED if wrong else "black")
    write(0.015, 0.954, facts, size=12)
    write(0.015, 0.932, reason, size=12)
    if story.differs:
        note = f"REPLAYED DIFFERENTLY; recorded: {_decision(story.recorded)}"
        write(0.985, 0.954, note, size=12, ha="right", color=RED)


def _decision(result: Result | None) -> str:
    if result is None:
        return "no result"
    return f"{result.outcome} {short_name(Account.of(result).answer)}".strip() + f" after {result.looks} looks"


def _candidate_spheres(figure: Figure, cells: GridSpec, story: Story) -> None:
    """A sphere per candidate; of two candidates a second one for the best hypothesis alone."""
    shown = story.ranking[:SPHERES]
    each = _spheres_each(story)
    view, final = panels.viewer(story), story.looks[-1].belief.estimate.candidates
    for place in range(each * len(shown)):
        rank, alone = divmod(place, each)
        k = shown[rank]
        axes = figure.add_subplot(cells[0, place])
        panels.candidate_sphere(axes, story, k, view, alone=bool(alone))
        text = f"{short_name(final[k].name)}\n{panels.standing(final[k])}"
        text = "\nits best hypothesis; thin: what w1 averages" if alone else text
        weight = "normal" if alone else "bold"
        axes.set_title(text, size=11, color=COLOURS[rank], weight=weight, pad=2, parse_math=False)
    handles = sphere.legend(story.goal)[: 4 if story.has_probabilities else None]  # a posterior has no paths
    figure.legend(handles=handles, loc="center", bbox_to_anchor=(0.5, 0.556), ncols=6, frameon=False, fontsize=10.5)


def _spheres_each(story: Story) -> int:
    """How many spheres a candidate has; a posterior has no best path to show alone."""
    return 2 if len(story.models) == 2 and not story.has_probabilities else 1


def _similarity(figure: Figure, cell: SubplotSpec, story: Story) -> None:
    """The similarity graph from both sides."""
    if not story.looks:
        say(figure.add_subplot(cell), "no percept: no poses to compare the candidates in")
        return
    graph, iteration, count = panels.differences(story)
    view = panels.difference_viewer(story, graph)
    parts = cell.subgridspec(1, 4, width_ratios=(1, 1, 0.04, 0.22), wspace=0.05)
    for column, (side, name) in enumerate(((view, "front"), (view.from_behind(), "from behind"))):
        panels.difference_sphere(figure.add_subplot(parts[0, column]), story, graph, side, name=name)
    mappable = ScalarMappable(panels.difference_norm(graph), sphere.VALUES)
    bar = figure.colorbar(mappable, cax=figure.add_subplot(parts[0, 2]))
    bar.set_label("smoothed variance of the features", size=9.5)
    bar.ax.tick_params(labelsize=9)
    when = f"when choosing the last {story.goal}" if story.targets else "at the end"
    _title(figure, cell, f"Where {count} candidates differ, {when} (look {iteration})")


def _pictures(figure: Figure, cell: SubplotSpec, story: Story) -> None:
    """The camera at the start and at the separating view, and what the candidates' models show in that direction."""
    if not story.frames:
        say(figure.add_subplot(cell), "the recording holds no camera pictures")
        return
    rank = story.ranking[:SPHERES] if story.looks else []
    rows = 1 if len(rank) <= 2 else 2  # of many candidates smaller pictures, in two rows beside the camera's
    columns = -(-len(rank) // rows)
    parts = cell.subgridspec(rows, 2 * rows + columns, wspace=0.1, hspace=0.3)
    reached = next((look for look in story.looks if look.phase is Phase.JUDGING), None)
    where = story.goal if reached else "last view"
    shown = reached or (story.looks[-1] if story.looks else None)
    first = story.frame_at(story.looks[0]) if story.looks else story.frames[0]
    last = story.frame_at(shown) if shown else story.frames[-1]
    _picture(figure.add_subplot(parts[:, :rows]), first.decode().image, "start view", "black")
    _picture(figure.add_subplot(parts[:, rows : 2 * rows]), last.decode().image, where, "black")
    if shown is not None:
        belief = shown.plan if reached and shown.plan else shown.belief
        for place, k in enumerate(rank):
            model, node = story.models[k], story.expected_node(k, belief, shown.percept.view_direction)
            axes = figure.add_subplot(parts[place // columns, 2 * rows + place % columns])
            _picture(axes, model.thumbnails[node], short_name(model.name, 24 // rows + 4), line_style(story, k)[0])
    models_too = f", and what the models show at the {where} (nearest node, any roll)" if shown else ""
    _title(figure, cell, f"What the camera saw{models_too}")


def _picture(axes: Axes, image: Array, text: str, colour: str) -> None:
    axes.imshow(image, interpolation="nearest" if image.shape[0] > 100 else "bilinear")
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set(color=colour, linewidth=1.5)
    axes.set_title(text, size=9.5, color=colour, pad=4, parse_math=False)


def _curve_legend(figure: Figure, story: Story) -> None:
    handles: list[Line2D | Patch] = []
    for k in story.ranking[: SPHERES + 1] if story.looks else []:
        colour, style, width = line_style(story, k)
        name = short_name(story.models[k].name) if colour != OTHERS else f"the others ({len(story.models) - SPHERES})"
        handles.append(Line2D([], [], color=colour, ls=style, lw=width, label=name))
    handles += [Patch(fc=shade, ec="0.6", lw=0.6, label=phase.value) for phase, shade in SHADES.items()]
    figure.legend(handles=handles, loc="center", bbox_to_anchor=(0.5, 0.245), ncols=8, frameon=False, fontsize=10.5)


def _title(figure: Figure, cell: SubplotSpec, text: str) -> None:
    box = cell.get_position(figure)
    figure.text(box.x0 + 0.004, box.y1 + 0.022, text, size=11.5)
