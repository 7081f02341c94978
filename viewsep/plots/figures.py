"""The figures of the page: the panels of the picture, each on its own, with words beside it."""

from __future__ import annotations

from dataclasses import dataclass

from markupsafe import Markup
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from viewsep.plots import panels
from viewsep.plots.panels import SPHERES, Curve, line_style
from viewsep.plots.story import Story
from viewsep.plots.svg import css_colour, inline
from viewsep.plots.telling import counted

SPHERE_IN, CURVE_IN = (3.6, 3.6), (4.6, 3.0)
LONG = 100  # looks; longer lines have no marks

OF_PATHS: tuple[tuple[Curve, str, str], ...] = (
    (
        panels.ratings,
        "Ratings",
        "How badly a candidate explains what was seen: 1 is best. Whoever is named needs all others above the dashed "
        "line.",
    ),
    (
        panels.path_course,
        "Path course",
        "How far a candidate's best path strays from the one that was really driven. The true object's follows it.",
    ),
    (
        panels.comparisons,
        "Feature comparisons",
        "The work of each look. Only views next to a hypothesis are compared, all of them when paths begin.",
    ),
    (
        panels.variance,
        "Running variance of the pose",
        "How much the believed pose still moves. Below the dashed line it has settled.",
    ),
)
OF_A_POSTERIOR: tuple[tuple[Curve, str, str], ...] = (
    (
        panels.probabilities,
        "Probability",
        "How probable a candidate is after each look, and, dotted, that it is none of them.",
    ),
    (
        panels.fit,
        "Fit",
        "How well a candidate explains each look by itself, seen from where it fits best: 1 is best.",
    ),
    (panels.comparisons, "Feature comparisons", "The work of each look."),
    (panels.spread, "Spread of the pose", "By how much the believed pose may be wrong."),
)


@dataclass(frozen=True, slots=True)
class Drawing:
    """A figure with its title and a sentence about it; `colour` is that of the candidate it is about, or empty."""

    svg: Markup
    title: str
    caption: str
    colour: str = ""


def sphere_drawings(story: Story) -> list[Drawing]:
    """A sphere for each of the best rated candidates; of two candidates a second one for the best hypothesis alone."""
    if not story.looks:
        return []
    drawings: list[Drawing] = []
    shown, view = story.ranking[:SPHERES], panels.viewer(story)
    final = story.looks[-1].belief.estimate.candidates
    for k in shown:
        for alone in (False, True) if len(shown) <= 2 and not story.has_probabilities else (False,):
            figure, axes = _sphere()
            panels.candidate_sphere(axes, story, k, view, alone=alone)
            name = final[k].name
            caption = panels.standing(final[k])
            caption = "its best path alone; thin lines are what w1 averages" if alone else caption
            label = f"View sphere of {name} with the driven path and {'the best path' if alone else 'the paths'}"
            colour = css_colour(line_style(story, k)[0])
            drawings.append(Drawing(inline(figure, f"s{k}{alone:d}", label), name, caption, colour))
    return drawings


def difference_drawings(story: Story) -> tuple[list[Drawing], str]:
    """Where the candidates differ, from both sides, and a sentence about when."""
    if not story.looks:
        return [], ""
    graph, iteration, count = panels.differences(story)
    drawings: list[Drawing] = []
    view = panels.difference_viewer(story, graph)
    for side, name in ((view, "front"), (view.from_behind(), "from behind")):
        figure, axes = _sphere()
        panels.difference_sphere(axes, story, graph, side, name=name)
        label = f"View sphere coloured by how much the candidates differ, {name}"
        drawings.append(Drawing(inline(figure, f"d{len(drawings)}", label), "", ""))
    when = f"when the last {story.goal} was chosen" if story.targets else "at the end"
    past = f"{'after' if story.has_probabilities else 'with paths of'} {counted(iteration, 'look')}"
    return drawings, (
        f"How much {count} candidates differ in each direction, {when}, {past}. "
        f"Dark blue: not at all; yellow: most (a smoothed variance of the features of {graph.smoothed.max():.2g})."
    )


def curve_drawings(story: Story) -> list[Drawing]:
    """How the candidates stood over the looks, what the looks took, and how well the poses were known."""
    drawings: list[Drawing] = []
    curves = OF_A_POSTERIOR if story.has_probabilities else OF_PATHS
    for draw, title, caption in curves if story.looks else ():
        figure = Figure(figsize=CURVE_IN)
        axes = figure.add_axes((0.14, 0.15, 0.845, 0.83))
        draw(axes, story)
        title = axes.get_title("left") or title
        axes.set_title("", loc="left")
        for line in axes.lines if len(story.looks) > LONG else ():
            line.set_marker("None")
        label = f"{title}: a line for each candidate over the looks" if draw is not panels.comparisons else title
        drawings.append(Drawing(inline(figure, f"c{len(drawings)}", label), title, caption))
    return drawings


def _sphere() -> tuple[Figure, Axes]:
    figure = Figure(figsize=SPHERE_IN)
    return figure, figure.add_axes((0.0, 0.0, 1.0, 1.0))
