"""The panels that a report is made of, each drawn into axes that are given: view spheres and curves over the looks."""

from __future__ import annotations

from collections.abc import Callable
from itertools import groupby

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.ticker import MaxNLocator

from viewsep.account import NONE_OF_THEM, percent
from viewsep.interpretation.interpreter import PathInterpreter
from viewsep.messages import CandidateEstimate, FloatArray, Phase
from viewsep.planning.separating_view import SimilarityGraph, similarity_graph
from viewsep.plots import sphere
from viewsep.plots.sphere import RED, Landmarks, SphereView
from viewsep.plots.story import Story

SPHERES = 4  # candidates with a sphere and a colour of their own
COLOURS = ("#0072B2", "#009E73", "#CC79A7", "#56B4E9")
STYLES = ("-", "--", "-.", ":")
OTHERS = "0.65"
NOBODY = "0.3"  # none of the candidates
SHADES = {Phase.EXPLORING: "1.0", Phase.APPROACHING: "0.95", Phase.JUDGING: "0.87"}


def line_style(story: Story, candidate: int) -> tuple[str, str, float]:
    """Colour, line style and width of a candidate: its own for the best rated, one for all others."""
    rank = story.ranking.index(candidate)
    return (COLOURS[rank], STYLES[rank], 1.8) if rank < SPHERES else (OTHERS, "-", 0.8)


def standing(candidate: CandidateEstimate) -> str:
    """How a candidate stands, in a few words."""
    if candidate.probability is None:
        return f"rating {candidate.rating:.3g}, w1 {np.degrees(candidate.w1):.1f}°"
    return f"probability {percent(candidate.probability)}, spread {np.degrees(np.sqrt(candidate.variance)):.1f}°"


# View spheres


def viewer(story: Story) -> SphereView:
    """From where all the candidates' spheres are looked at: the side of the path and of the last separating view."""
    controlled, targets = story.controlled, story.separating_views
    return SphereView.facing(np.concatenate([controlled, np.repeat(targets[-1:], len(controlled), axis=0)]))


def candidate_sphere(axes: Axes, story: Story, k: int, view: SphereView, *, alone: bool = False) -> None:
    """A candidate's graph in its pose, the controlled path and the hypotheses (Figs. 3d, 5b, 5c).

    `alone` shows the best hypothesis only, and the angles that its w1 averages.
    """
    colour, model = line_style(story, k)[0], story.models[k]
    paths, rotation = story.hypotheses(k)
    sphere.draw_globe(axes, view)
    sphere.draw_graph(axes, view, model.directions @ rotation.T, model.edges)
    if alone and paths:
        since_begun = story.controlled[-len(paths[0]) :]  # paths that were lost began anew
        sphere.draw_distances(axes, view, since_begun, paths[0], colour=colour)
    sphere.draw_hypotheses(axes, view, paths[:1] if alone else paths, colour=colour)
    _landmarks(story).draw(axes, view, see_through=True)


def differences(story: Story) -> tuple[SimilarityGraph, int, int]:
    """The similarity graph that the last separating view was chosen from, otherwise that at the end (Fig. 5a).

    Then the number of the look it was made after, since the paths began, and of the candidates in it.
    """
    belief = story.targets[-1].belief if story.targets else story.looks[-1].belief
    models = [model for model, plausible in zip(story.models, belief.plausible, strict=True) if plausible]
    graph = similarity_graph(models, belief.rotations[belief.plausible])
    return graph, belief.estimate.iteration, len(models)


def difference_norm(graph: SimilarityGraph) -> Normalize:
    """Colours from no difference to the greatest one."""
    return Normalize(0.0, float(graph.smoothed.max()) or 1.0)


def difference_viewer(story: Story, graph: SimilarityGraph) -> SphereView:
    """From where the similarity graph is looked at: the side of the last separating view."""
    peak = graph.directions[[np.argmax(graph.smoothed)]]
    return SphereView.facing(story.separating_views[-1:] if story.targets else peak)


def difference_sphere(axes: Axes, story: Story, graph: SimilarityGraph, view: SphereView, *, name: str) -> None:
    """How much the candidates differ, seen from one side."""
    sphere.draw_globe(axes, view, name=name)
    sphere.draw_values(axes, view, graph.directions, graph.smoothed, difference_norm(graph))
    _landmarks(story).draw(axes, view)


def _landmarks(story: Story) -> Landmarks:
    """What every sphere shows."""
    return Landmarks(story.controlled, story.separating_views)


# Curves over the looks


def path_course(axes: Axes, story: Story) -> None:
    """w1 of the best hypotheses (Fig. 6b)."""
    _lines(axes, story, np.degrees(story.series("w1")))
    axes.set_ylim(bottom=0.0)
    _label(axes, story, "Path course w1 of the best hypothesis", "degrees, mean over the path")


def ratings(axes: Axes, story: Story) -> None:
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


def probabilities(axes: Axes, story: Story) -> None:
    """The probability of each candidate and of none of them."""
    probability = story.series("probability")
    ends = f"at the end {percent(np.nanmax(probability[-1]))}"
    _lines(axes, story, probability)
    if len(story.unknown):
        dots = (0, (1, 1.2))
        axes.plot(story.iterations, story.unknown, color=NOBODY, lw=1.8, ls=dots, label=NONE_OF_THEM)
        axes.legend(loc="center right", fontsize=8.5, framealpha=0.8)
        if story.unknown[-1] > np.nanmax(probability[-1]):
            ends = f"at the end {NONE_OF_THEM} {percent(story.unknown[-1])}"
    axes.set_ylim(-0.03, 1.03)
    _label(axes, story, f"Probability ({ends})", "0 to 1")


def fit(axes: Axes, story: Story) -> None:
    """How well each look fits a candidate at best."""
    _lines(axes, story, story.series("w0"))
    axes.set_ylim(-0.03, 1.03)
    _label(axes, story, "Fit w0 of the look where it fits best", "0 to 1")


def spread(axes: Axes, story: Story) -> None:
    """By how much the poses may be wrong."""
    _lines(axes, story, np.degrees(np.sqrt(story.series("variance"))))
    axes.set_ylim(bottom=0.0)
    _label(axes, story, "Spread of the pose", "degrees, root mean squared")


def comparisons(axes: Axes, story: Story) -> None:
    """Feature comparisons per iteration beside brute force (Fig. 6c)."""
    made = [look.belief.estimate.comparisons for look in story.looks]
    nodes = story.brute_force
    axes.plot(story.iterations, made, color="black", lw=1.6, marker=".", ms=3)
    axes.axhline(nodes, color=RED, lw=1.4, ls="--", label=f"brute force: all {nodes} nodes")
    axes.set_ylim(0.0, 1.22 * max(nodes, *made))
    axes.legend(loc="upper right", fontsize=8.5, framealpha=0.8)
    share = sum(made) / (nodes * len(made))
    _label(axes, story, f"Feature comparisons ({100 * share:.0f} % of brute force)", "comparisons per look")


def variance(axes: Axes, story: Story) -> None:
    """The running variance of the poses and the bound for convergence (section IV.E)."""
    variance = np.degrees(np.sqrt(story.series("variance"))) ** 2
    variance = np.where(np.isfinite(variance) & (variance > 0.0), variance, np.nan)
    if np.isnan(variance).all():
        say(axes, "no running variance:\ntoo few looks")
        return
    axes.set_yscale("log")
    _lines(axes, story, variance)
    if isinstance(story.interpreter, PathInterpreter):
        bound = story.interpreter.options.variance_limit_deg2
        axes.axhline(bound, color="black", lw=1.2, ls=(0, (4, 2)), label=f"converged below {bound:g} deg²")
        axes.legend(loc="upper right", fontsize=8.5, framealpha=0.8)
    _label(axes, story, "Running variance of the pose", "deg², summed over the angles")


Curve = Callable[[Axes, Story], None]


def curves(story: Story) -> tuple[Curve, ...]:
    """The four curves that show how the decision came about."""
    if story.has_probabilities:
        return probabilities, fit, comparisons, spread
    return path_course, ratings, comparisons, variance


def say(axes: Axes, text: str) -> None:
    """A panel that has nothing to draw says so."""
    axes.set(xticks=[], yticks=[])
    axes.spines[:].set_color("0.8")
    axes.text(0.5, 0.5, text, transform=axes.transAxes, ha="center", va="center", size=12, color="0.35")


def _lines(axes: Axes, story: Story, values: FloatArray) -> None:
    """One line per candidate from values (H, K), the best rated on top."""
    for k in reversed(story.ranking):
        colour, style, width = line_style(story, k)
        axes.plot(story.iterations, values[:, k], color=colour, ls=style, lw=width, marker=".", ms=3)


def _label(axes: Axes, story: Story, title: str, unit: str) -> None:
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
