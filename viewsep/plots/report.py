"""One picture of one separation task, drawn from its recording: what was seen, believed, planned and concluded."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from textwrap import shorten
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec, SubplotSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from viewsep.assembly import make_engine
from viewsep.config import Config, geometry_of
from viewsep.engine.state import EngineState
from viewsep.geometry import angle_between
from viewsep.interfaces import Interpretation, Interpreter
from viewsep.interpretation.interpreter import PathInterpreter, PathState
from viewsep.messages import Array, FloatArray, Outcome, Percept, PerceptReceived, Phase, Result, TaskStarted
from viewsep.models.aspect_graph import AspectGraph
from viewsep.planning.separating_view import similarity_graph
from viewsep.plots import sphere
from viewsep.plots.contact_sheet import short_name, write_png
from viewsep.plots.sphere import RED, Landmarks, SphereView
from viewsep.recordings.codec import RecordedFrame
from viewsep.recordings.reader import Recording
from viewsep.recordings.replay import replay, restore

SPHERES = 4  # candidates with a sphere and a colour of their own
COLOURS = ("#0072B2", "#009E73", "#CC79A7", "#56B4E9")
STYLES = ("-", "--", "-.", ":")
OTHERS = "0.65"
SHADES = {Phase.EXPLORING: "1.0", Phase.APPROACHING: "0.95", Phase.JUDGING: "0.87"}


@dataclass(frozen=True, eq=False, slots=True)
class _Look:
    """One iteration of the interpretation; `phase` is the one the view was seen in."""

    percept: Percept
    phase: Phase
    belief: Interpretation


@dataclass(frozen=True, eq=False, slots=True)
class _Story:
    """A replayed recording: `targets` (T, 3) are the separating views, `plans` the T beliefs that chose them."""

    config: Config
    models: list[AspectGraph]
    interpreter: Interpreter
    task: dict[str, str]
    looks: list[_Look]
    targets: FloatArray
    plans: list[Interpretation]
    end: EngineState | None
    recorded: Result | None
    frames: tuple[RecordedFrame, ...]

    @property
    def controlled(self) -> FloatArray:
        """(H, 3) the controlled path."""
        return np.array([look.percept.view_direction for look in self.looks]).reshape(-1, 3)

    @property
    def ranking(self) -> list[int]:
        """Candidates in the order of their last rating, best first."""
        if not self.looks:
            return list(range(len(self.models)))
        return [int(k) for k in np.argsort(self.series("rating")[-1], kind="stable")]

    def frame_at(self, look: _Look) -> RecordedFrame:
        """The recorded frame nearest in time."""
        return min(self.frames, key=lambda frame: abs(frame.stamp_ns - look.percept.stamp_ns))

    def series(self, measure: str) -> FloatArray:
        """(H, K) a measure of the candidates' estimates over the iterations."""
        rows = [[getattr(c, measure) for c in look.belief.estimate.candidates] for look in self.looks]
        return np.array(rows, np.float64).reshape(len(rows), len(self.models))

    @property
    def iterations(self) -> Array:
        """(H,) the looks' numbers, from 1."""
        return np.arange(1, len(self.looks) + 1)

    @property
    def landmarks(self) -> Landmarks:
        """What every sphere shows."""
        return Landmarks(self.controlled, self.targets)

    def style(self, candidate: int) -> tuple[str, str, float]:
        """Colour, line style and width of a candidate: its own for the best rated, one for all others."""
        rank = self.ranking.index(candidate)
        return (COLOURS[rank], STYLES[rank], 1.8) if rank < SPHERES else (OTHERS, "-", 0.8)


def report(recording: Recording, path: Path) -> None:
    """Write a PNG of 1600 x 1200 pixels that tells the recorded task (the paper's Figs. 3, 5 and 6 for one run).

    Raises BadInput when `path` cannot be written, BadRecording when the recording cannot be replayed.
    """
    story = _retell(recording)
    figure = Figure(figsize=(16.0, 12.0), dpi=100, facecolor="white")
    _headline(figure, story)
    columns = 3 if len(story.models) == 3 else 4
    side = 0.01 + 0.1225 * (4 - columns)
    spheres = GridSpec(1, columns, figure, left=side, right=1.0 - side, top=0.88, bottom=0.575, wspace=0.02)
    middle = GridSpec(1, 2, figure, left=0.01, right=0.99, top=0.495, bottom=0.285, wspace=0.03, width_ratios=(4, 5))
    curves = GridSpec(1, 4, figure, left=0.045, right=0.99, top=0.205, bottom=0.042, wspace=0.24)
    if story.looks:
        _candidate_spheres(figure, spheres, story)
    else:
        _say(figure.add_subplot(spheres[:]), "no percept was interpreted: there are no paths to show")
    _similarity(figure, middle[0], story)
    _pictures(figure, middle[1], story)
    for column, panel in enumerate((_path_course, _ratings, _comparisons, _variance)):
        axes = figure.add_subplot(curves[0, column])
        if story.looks:
            panel(axes, story)
        else:
            _say(axes, "no percept")
    _curve_legend(figure, story)
    write_png(figure, path)


def _retell(recording: Recording) -> _Story:
    """Replay the recording and keep what the pictures need."""
    config, models = restore(recording)
    looks: list[_Look] = []
    targets: list[FloatArray] = []
    plans: list[Interpretation] = []
    end: EngineState | None = None
    for step in replay(recording):
        before, end = end or EngineState(), step.state
        if isinstance(step.event, TaskStarted):
            looks, targets, plans = [], [], []
        if isinstance(step.event, PerceptReceived) and end.belief is not None and end.belief is not before.belief:
            looks.append(_Look(step.event.percept, before.phase, end.belief))
        target = end.move_plan.target if end.move_plan else None
        known = before.move_plan.target if before.move_plan else None
        if target is not None and end.belief and (known is None or not np.array_equal(target, known)):
            targets.append(target)
            plans.append(end.belief)
    interpreter = make_engine(config, models).interpreter
    views = np.array(targets).reshape(-1, 3)
    recorded = next((r.message for r in recording.messages if isinstance(r.message, Result)), None)
    return _Story(
        config, models, interpreter, recording.metadata["task"], looks, views, plans, end, recorded, recording.frames
    )


def _headline(figure: Figure, story: _Story) -> None:
    """Outcome, object and truth; the engine's reason; looks, travel, seed and rig; whether the replay agrees."""
    result = story.end.result if story.end else None
    truth = short_name(story.task.get("truth", ""), 36)
    wrong = False
    if result is None:
        travel = story.end.travel_rad if story.end else 0.0
        says, reason = "no result", "the recording ends before the task"
    else:
        says, reason, travel = result.outcome.value, result.reason, result.travel_rad
    if result is not None and result.outcome is Outcome.IDENTIFIED:
        named = short_name(result.object, 36)
        wrong = story.task.get("truth", "") not in ("", result.object)
        verdict = f"wrong, it was {truth}" if wrong else "right" if truth else "truth not recorded"
        says += f": {named} ({verdict})"
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
    if _decision(story.recorded) != _decision(result):
        note = f"REPLAYED DIFFERENTLY; recorded: {_decision(story.recorded)}"
        write(0.985, 0.954, note, size=12, ha="right", color=RED)


def _decision(result: Result | None) -> str:
    if result is None:
        return "no result"
    return f"{result.outcome} {short_name(result.object)}".strip() + f" after {result.looks} looks"


# View spheres


def _candidate_spheres(figure: Figure, cells: GridSpec, story: _Story) -> None:
    """A sphere per candidate; of two candidates a second one for the best hypothesis alone (Figs. 3d, 5b, 5c)."""
    shown = story.ranking[:SPHERES]
    each = 2 if len(shown) == 2 else 1
    view = SphereView.facing(
        np.concatenate([story.controlled, np.repeat(story.targets[-1:], len(story.looks), axis=0)])
    )
    final = story.looks[-1].belief.estimate.candidates
    for place in range(each * len(shown)):
        rank, alone = divmod(place, each)
        k, colour = shown[rank], COLOURS[rank]
        paths, rotation = _hypotheses(story, k)
        axes = figure.add_subplot(cells[0, place])
        sphere.draw_globe(axes, view)
        sphere.draw_graph(axes, view, story.models[k].directions @ rotation.T, story.models[k].edges)
        if alone and paths:
            since_begun = story.controlled[-len(paths[0]) :]  # paths that were lost began anew
            sphere.draw_distances(axes, view, since_begun, paths[0], colour=colour)
        sphere.draw_hypotheses(axes, view, paths[:1] if alone else paths, colour=colour)
        story.landmarks.draw(axes, view, see_through=True)
        text = f"{short_name(final[k].name)}\nrating {final[k].rating:.3g}, w1 {np.degrees(final[k].w1):.1f}°"
        text = "\nits best hypothesis; thin: what w1 averages" if alone else text
        axes.set_title(text, size=11, color=colour, weight="normal" if alone else "bold", pad=2, parse_math=False)
    handles = sphere.legend()
    figure.legend(handles=handles, loc="center", bbox_to_anchor=(0.5, 0.556), ncols=6, frameon=False, fontsize=10.5)


def _hypotheses(story: _Story, k: int) -> tuple[list[FloatArray], FloatArray]:
    """A candidate's paths (H, 3) at the end in the control frame, best first, and the best one's rotation (3, 3).

    No paths and the estimated rotation for an interpreter without path hypotheses.
    """
    state = story.end.interpretation if story.end else None
    if not isinstance(state, PathState) or not isinstance(story.interpreter, PathInterpreter) or not state.hypotheses:
        return [], story.looks[-1].belief.rotations[k]
    mine = state.hypotheses.take(np.flatnonzero(story.interpreter.owner(state.hypotheses) == k))
    mine = mine.take(np.lexsort((mine.w1, mine.rating)))
    directions = story.interpreter.candidates.directions
    paths = [directions[hits] @ rotation.T for hits, rotation in zip(mine.hits, mine.rotation, strict=True)]
    return paths, mine.rotation[0]


def _similarity(figure: Figure, cell: SubplotSpec, story: _Story) -> None:
    """The similarity graph the last separating view was chosen from, otherwise that at the end (Fig. 5a)."""
    if not story.looks:
        _say(figure.add_subplot(cell), "no percept: no poses to compare the candidates in")
        return
    belief = (story.plans or [story.looks[-1].belief])[-1]
    models = [model for model, plausible in zip(story.models, belief.plausible, strict=True) if plausible]
    graph = similarity_graph(models, belief.rotations[belief.plausible])
    norm = Normalize(0.0, float(graph.smoothed.max()) or 1.0)
    peak = graph.directions[[np.argmax(graph.smoothed)]]
    view = SphereView.facing(story.targets[-1:] if len(story.targets) else peak)
    parts = cell.subgridspec(1, 4, width_ratios=(1, 1, 0.04, 0.22), wspace=0.05)
    for column, (side, name) in enumerate(((view, "front"), (view.from_behind(), "from behind"))):
        axes = figure.add_subplot(parts[0, column])
        sphere.draw_globe(axes, side, name=name)
        sphere.draw_values(axes, side, graph.directions, graph.smoothed, norm)
        story.landmarks.draw(axes, side)
    bar = figure.colorbar(ScalarMappable(norm, sphere.VALUES), cax=figure.add_subplot(parts[0, 2]))
    bar.set_label("smoothed variance of the features", size=9.5)
    bar.ax.tick_params(labelsize=9)
    when = "when choosing the last separating view" if story.plans else "at the end"
    _title(figure, cell, f"Where {len(models)} candidates differ, {when} (look {belief.estimate.iteration})")


# Camera pictures


def _pictures(figure: Figure, cell: SubplotSpec, story: _Story) -> None:
    """The camera at the start and at the separating view, and what the candidates' models show in that direction."""
    if not story.frames:
        _say(figure.add_subplot(cell), "the recording holds no camera pictures")
        return
    rank = story.ranking[:SPHERES] if story.looks else []
    rows = 1 if len(rank) <= 2 else 2  # of many candidates smaller pictures, in two rows beside the camera's
    columns = -(-len(rank) // rows)
    parts = cell.subgridspec(rows, 2 * rows + columns, wspace=0.1, hspace=0.3)
    reached = next((look for look in story.looks if look.phase is Phase.JUDGING), None)
    where = "separating view" if reached else "last view"
    shown = reached or (story.looks[-1] if story.looks else None)
    first = story.frame_at(story.looks[0]) if story.looks else story.frames[0]
    last = story.frame_at(shown) if shown else story.frames[-1]
    _picture(figure.add_subplot(parts[:, :rows]), first.decode().image, "start view", "black")
    _picture(figure.add_subplot(parts[:, rows : 2 * rows]), last.decode().image, where, "black")
    if shown is not None:
        belief = story.plans[0] if reached and story.plans else shown.belief
        for place, k in enumerate(rank):
            model, expected = story.models[k], belief.rotations[k].T @ shown.percept.view_direction
            node = int(np.argmin(angle_between(model.directions, expected)))
            axes = figure.add_subplot(parts[place // columns, 2 * rows + place % columns])
            _picture(axes, model.thumbnails[node], short_name(model.name, 24 // rows + 4), story.style(k)[0])
    models_too = f", and what the models show at the {where} (nearest node, any roll)" if shown else ""
    _title(figure, cell, f"What the camera saw{models_too}")


def _picture(axes: Axes, image: Array, text: str, colour: str) -> None:
    axes.imshow(image, interpolation="nearest" if image.shape[0] > 100 else "bilinear")
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set(color=colour, linewidth=1.5)
    axes.set_title(text, size=9.5, color=colour, pad=4, parse_math=False)


# Curves over the iterations


def _path_course(axes: Axes, story: _Story) -> None:
    """w1 of the best hypotheses (Fig. 6b)."""
    _lines(axes, story, np.degrees(story.series("w1")))
    axes.set_ylim(bottom=0.0)
    _label(axes, story, "Path course w1 of the best hypothesis", "degrees, mean over the path")


def _ratings(axes: Axes, story: _Story) -> None:
    """The ratings and the bound that every rival must lie above for a decision (section V.B)."""
    rating = story.series("rating")
    axes.set_yscale("log")
    _lines(axes, story, rating)
    if isinstance(story.interpreter, PathInterpreter):
        factor = story.interpreter.options.plausible_within
        bound = factor * rating.min(axis=1)
        says = f"{factor:g} times the best: near a separating view it\nmay be named when all others are above"
        axes.plot(story.iterations, bound, color="black", lw=1.2, ls=(0, (4, 2)), label=says)
        axes.set_ylim(0.6 * rating.min(), 8.0 * max(rating.max(), bound.max()))
        axes.legend(loc="upper left", fontsize=8.5, framealpha=0.8)
    best, following = np.sort(rating[-1])[:2]
    _label(axes, story, f"Rating (at the end 1 : {following / best:.1f})", "mean queue position, 1 = best")


def _comparisons(axes: Axes, story: _Story) -> None:
    """Feature comparisons per iteration beside brute force (Fig. 6c)."""
    made = [look.belief.estimate.comparisons for look in story.looks]
    nodes = sum(len(model.directions) for model in story.models)
    axes.plot(story.iterations, made, color="black", lw=1.6, marker=".", ms=3)
    axes.axhline(nodes, color=RED, lw=1.4, ls="--", label=f"brute force: all {nodes} nodes")
    axes.set_ylim(0.0, 1.22 * max(nodes, *made))
    axes.legend(loc="upper right", fontsize=8.5, framealpha=0.8)
    share = sum(made) / (nodes * len(made))
    _label(axes, story, f"Feature comparisons ({100 * share:.0f} % of brute force)", "comparisons per look")


def _variance(axes: Axes, story: _Story) -> None:
    """The running variance of the poses and the bound for convergence (section IV.E)."""
    variance = np.degrees(np.sqrt(story.series("variance"))) ** 2
    variance = np.where(np.isfinite(variance) & (variance > 0.0), variance, np.nan)
    if np.isnan(variance).all():
        _say(axes, "no running variance:\ntoo few looks")
        return
    axes.set_yscale("log")
    _lines(axes, story, variance)
    if isinstance(story.interpreter, PathInterpreter):
        bound = story.interpreter.options.variance_limit_deg2
        axes.axhline(bound, color="black", lw=1.2, ls=(0, (4, 2)), label=f"converged below {bound:g} deg²")
        axes.legend(loc="upper right", fontsize=8.5, framealpha=0.8)
    _label(axes, story, "Running variance of the pose", "deg², summed over the angles")


def _lines(axes: Axes, story: _Story, values: FloatArray) -> None:
    """One line per candidate from values (H, K), the best rated on top."""
    for k in reversed(story.ranking):
        colour, style, width = story.style(k)
        axes.plot(story.iterations, values[:, k], color=colour, ls=style, lw=width, marker=".", ms=3)


def _label(axes: Axes, story: _Story, title: str, unit: str) -> None:
    """Titles, limits and the phases' shades."""
    axes.set_title(title, size=11, loc="left")
    axes.set_ylabel(unit, size=9.5)
    axes.set_xlabel("look", size=9.5)
    axes.tick_params(labelsize=9)
    axes.set_xlim(0.5, len(story.looks) + 0.5)
    axes.xaxis.set_major_locator(MaxNLocator("auto", integer=True))
    begin = 0.5
    for phase, looks in groupby(story.looks, key=lambda look: look.phase):
        end = begin + len(list(looks))
        axes.axvspan(begin, end, color=SHADES[phase], lw=0, zorder=0)
        begin = end


def _curve_legend(figure: Figure, story: _Story) -> None:
    handles: list[Line2D | Patch] = []
    for k in story.ranking[: SPHERES + 1] if story.looks else []:
        colour, style, width = story.style(k)
        name = short_name(story.models[k].name) if colour != OTHERS else f"the others ({len(story.models) - SPHERES})"
        handles.append(Line2D([], [], color=colour, ls=style, lw=width, label=name))
    handles += [Patch(fc=shade, ec="0.6", lw=0.6, label=phase.value) for phase, shade in SHADES.items()]
    figure.legend(handles=handles, loc="center", bbox_to_anchor=(0.5, 0.245), ncols=8, frameon=False, fontsize=10.5)


def _title(figure: Figure, cell: SubplotSpec, text: str) -> None:
    box = cell.get_position(figure)
    figure.text(box.x0 + 0.004, box.y1 + 0.022, text, size=11.5)


def _say(axes: Axes, text: str) -> None:
    """A panel that has nothing to draw says so."""
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_color("0.8")
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", size=12, color="0.35")
