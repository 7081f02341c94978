"""One HTML page of one separation task, drawn from its recording: whole in itself, it needs no network and no file.

The texts are filled into `templates/page.html`, which escapes them; the page's style and script stand beside it.
"""

from __future__ import annotations

import re
from base64 import b64encode
from dataclasses import dataclass
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from viewsep import __version__
from viewsep.account import NONE_OF_THEM
from viewsep.files import write_whole
from viewsep.messages import Phase
from viewsep.plots import svg
from viewsep.plots.events import happenings
from viewsep.plots.facts import bar, config_text, deviations, key_figures, rated_candidates, records
from viewsep.plots.figures import curve_drawings, difference_drawings, sphere_drawings
from viewsep.plots.panels import NOBODY, OTHERS, SHADES, SPHERES, line_style
from viewsep.plots.snapshots import large, thumbnail
from viewsep.plots.sphere import RED, YELLOW
from viewsep.plots.steps import steps_of
from viewsep.plots.story import Look, Story, retell
from viewsep.plots.svg import css_colour
from viewsep.plots.telling import decide, factor_of, outcome_in_words, rig_in_words, seen_from
from viewsep.plots.timeline import axis_of, rows_of
from viewsep.recordings.reader import Recording

UNSEEN = (*range(0x09), 0x0B, 0x0C, *range(0x0E, 0x20), 0x7F, *range(0x202A, 0x202F), *range(0x2066, 0x206A))
"""Control characters, which have no look of their own, and marks that turn the direction of what follows."""


@dataclass(frozen=True, slots=True)
class View:
    """A large picture, empty `source` where there is none; `title` and `words` say what it shows."""

    source: str
    title: str
    words: str
    colour: str = ""


def write_page(recording: Recording, path: Path, source: str = "") -> None:
    """Write a page that tells the recorded task; `source` is the recording's name, for the reader.

    Raises BadInput when `path` cannot be written, BadRecording when the recording cannot be replayed.
    """
    write_whole(path, page_of(retell(recording), source).encode("utf-8", "replace"), "page")


def page_of(story: Story, source: str = "") -> str:
    """The page's HTML; the same story gives the same text."""
    environment = Environment(
        loader=PackageLoader("viewsep.plots"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_visible,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["breakable"] = _breakable
    script = _packaged("page.js")
    spheres, curves = sphere_drawings(story), curve_drawings(story)
    differences, difference_words = difference_drawings(story)
    lines, shades = _lines(story), [(phase.value, css_colour(shade)) for phase, shade in SHADES.items()]
    used = [*(drawing.svg for drawing in (*spheres, *differences, *curves)), *(colour for _, colour, _ in lines)]
    others = [css_colour(colour) for colour in (RED, YELLOW, NOBODY)]
    light, dark = svg.themes("".join([*used, *(colour for _, colour in shades), *others]))
    events, left_out = happenings(story)
    factor = factor_of(story)
    return environment.get_template("page.html").render(
        style=_packaged("page.css"),
        script=script,
        script_digest=b64encode(sha256(script.encode()).digest()).decode(),
        light=Markup(light),
        dark=Markup(dark),
        source=source,
        version=__version__,
        decision=decide(story),
        rig=rig_in_words(story.config)[1],
        differs=story.differs,
        recorded=outcome_in_words(story.recorded),
        replayed=outcome_in_words(story.result),
        rated=rated_candidates(story),
        factor=factor,
        factor_percent=bar(factor or 1.0),
        facts=key_figures(story),
        seen=_camera_views(story),
        expected=_expected_views(story),
        steps=steps_of(story),
        has_probabilities=story.has_probabilities,
        goal=story.goal,
        judging="waiting for a look" if story.by_information else "judging at it",
        candidates=_believed(story),
        timeline=rows_of(story),
        ticks=axis_of(story).ticks(),
        spheres=spheres,
        differences=differences,
        difference_words=difference_words,
        curves=curves,
        lines=lines,
        shades=shades,
        path_colour=css_colour(RED),
        star_colour=css_colour(YELLOW),
        events=events,
        left_out=left_out,
        models=story.models,
        deviations=deviations(story.config),
        config=config_text(story.config),
        records=records(story),
    )


def _packaged(name: str) -> Markup:
    return Markup((files("viewsep.plots") / "templates" / name).read_text(encoding="utf-8"))


def _visible(value: Any) -> Any:
    """Texts with a sign for every character that would not be seen."""
    return value.translate(dict.fromkeys(UNSEEN, "\ufffd")) if isinstance(value, str) else value


def _breakable(name: str) -> Markup:
    """A name that may be broken where its words end."""
    return Markup(re.sub(r"(?<=[_.-])(?=\w)", "<wbr>", str(escape(name))))


def _believed(story: Story) -> list[tuple[str, str]]:
    """Name and colour of each row of the estimates."""
    rows = [(story.models[k].name, css_colour(line_style(story, k)[0])) for k in story.ranking]
    return [*rows, (NONE_OF_THEM, css_colour(NOBODY))] if len(story.unknown) else rows


def _lines(story: Story) -> list[tuple[str, str, str]]:
    """Name, colour and dashes of the lines in the curves."""
    dashes = {"-": "", "--": "7 3", "-.": "8 2 2 2", ":": "2 2"}
    shown = story.ranking[:SPHERES] if story.looks else []
    lines = []
    for k in shown:
        colour, style, _ = line_style(story, k)
        lines.append((story.models[k].name, css_colour(colour), dashes[style]))
    others = len(story.models) - SPHERES
    return [*lines, (f"the others ({others})", css_colour(OTHERS), "")] if shown and others > 0 else lines


def _shown_look(story: Story) -> tuple[Look | None, str]:
    """The look at the separating view that was reached last, or else the last one; and what to call it."""
    for number in range(len(story.looks), 0, -1):
        if story.looks[number - 1].phase is Phase.JUDGING:
            return story.looks[number - 1], f"{story.goal.capitalize()}, look {number}"
    if not story.looks:
        return None, "Last picture"
    return story.looks[-1], f"Last view, look {len(story.looks)}"


def _camera_views(story: Story) -> list[View]:
    """The camera at the start and at the separating view."""
    if not story.frames:
        return []
    shown, title = _shown_look(story)
    if shown is None:
        return [View(large(story.frames[-1].decode().image), title, "No view was interpreted")]
    return [
        View(large(story.frame_at(look).decode().image), name, f"From {seen_from(look.percept.view_direction)}")
        for look, name in ((story.looks[0], "Start, look 1"), (shown, title))
    ]


def _expected_views(story: Story) -> list[View]:
    """What every candidate's model shows from where the camera looked, in the pose it was believed to have."""
    look, _ = _shown_look(story)
    if look is None:
        return []
    views = []
    for k in story.ranking:
        model, belief = story.models[k], look.plan or look.belief
        node = story.expected_node(k, belief, look.percept.view_direction)
        words = f"View {node + 1} of {len(model.directions)}"
        views.append(View(thumbnail(model.thumbnails[node]), model.name, words, css_colour(line_style(story, k)[0])))
    return views
