"""The figures and settings of a task as rows of words: what it took, how it ended, what it was done with."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from math import log
from typing import Any

import numpy as np
import tomlkit

from viewsep.account import NONE_OF_THEM, percent
from viewsep.config import Config
from viewsep.geometry import matrix_to_quaternion
from viewsep.messages import Outcome, Phase
from viewsep.plots.panels import NOBODY, line_style
from viewsep.plots.story import Story
from viewsep.plots.svg import css_colour
from viewsep.plots.telling import counted, factor_of, final_probabilities, final_ratings, rig_in_words
from viewsep.plots.timeline import axis_of

FULL_BAR = 20.0  # times the best rating
NAMED = 4  # candidates among the key figures


@dataclass(frozen=True, slots=True)
class Fact:
    """A key figure: a `value` and, smaller, a `note` about it."""

    name: str
    value: str
    note: str = ""


@dataclass(frozen=True, slots=True)
class Rated:
    """A candidate's last rating; `percent` is the length of its bar, `standing` what the rating means for it.

    Of an interpreter with probabilities `rating` is the probability, and `times` empty. `true` says that it is what the
    rig held.
    """

    name: str
    colour: str
    rating: str
    times: str
    percent: float
    standing: str
    true: bool


def key_figures(story: Story) -> list[Fact]:
    """What the task took and what it was done with."""
    axis, looks = axis_of(story), len(story.looks)
    travel = story.end.travel_rad if story.end else 0.0
    made = sum(look.belief.estimate.comparisons for look in story.looks)
    share = f"{100 * made / (story.brute_force * looks):.0f} % of comparing with every view" if looks else ""
    reached = sum(phase is Phase.JUDGING for _, phase in story.course)
    driven = f"{counted(reached, story.goal)} reached"
    if story.by_information:
        driven = f"{counted(len(story.targets), story.goal)} driven to"
    rig, simulated = rig_in_words(story.config)
    build = story.recording.metadata.get("build", {})
    facts = [
        Fact("Looks", str(looks), driven),
        Fact("Travel", f"{np.degrees(travel):.0f}°", "on the view sphere"),
        Fact("Time", f"{axis.seconds(axis.end_ns):.1f} s", _recorded_at(story, axis.begin_ns)),
        Fact("Comparisons", str(made), share),
        Fact("Candidates", str(len(story.models)), _digests(story)),
        Fact("Seed", story.task.get("seed", "not recorded"), "of start view and direction"),
        Fact("Rig", rig, simulated),
        Fact("Build", f"viewsep {build.get('viewsep', 'unknown')}", _platform(build)),
    ]
    if story.result is not None and story.result.outcome is Outcome.IDENTIFIED:
        pose = " ".join(f"{x:+.3f}" for x in matrix_to_quaternion(story.result.rotation))
        facts.append(Fact("Pose", pose, "quaternion x y z w, object to control frame"))
    return facts


def rated_candidates(story: Story) -> list[Rated]:
    """The candidates at the end, best first; where they have probabilities, none of them comes last."""
    if story.has_probabilities:
        return _probable_candidates(story)
    factor = factor_of(story)
    named = story.result.object if story.result else ""
    rows = []
    for k, (name, rating, times) in zip(story.ranking, final_ratings(story), strict=False):
        standing = "" if factor is None else "ruled out" if times >= factor else "possible"
        standing = "named" if name == named else standing
        colour = css_colour(line_style(story, k)[0])
        rows.append(Rated(name, colour, f"{rating:.3g}", f"{times:.1f}", bar(times), standing, name == story.truth))
    return rows


def _probable_candidates(story: Story) -> list[Rated]:
    named = story.result.object if story.result else ""
    unknown = story.result is not None and story.result.outcome is Outcome.UNKNOWN
    left = story.result.indistinct if story.result else ()
    colours = {story.models[k].name: line_style(story, k)[0] for k in story.ranking}
    rows = []
    for name, probability in final_probabilities(story):
        standing = "named" if name == named or (unknown and name == NONE_OF_THEM) else "possible" * (name in left)
        colour = css_colour(colours.get(name, NOBODY))
        true = name == story.truth or (name == NONE_OF_THEM and story.truth not in ("", *colours))
        rows.append(Rated(name, colour, percent(probability), "", round(100 * probability, 1), standing, true))
    return rows


def bar(times: float) -> float:
    """The length in per cent of a bar for a rating so many times the best one; logarithmic."""
    return round(100.0 * min(log(max(times, 1.0)) / log(FULL_BAR), 1.0), 1)


def config_text(config: Config) -> str:
    """The configuration as the TOML file that it could have come from."""
    return tomlkit.dumps(_without_none(config.model_dump(mode="json")))


def deviations(config: Config) -> list[tuple[str, str, str]]:
    """Key, value and default of all that was set otherwise than by default."""
    defaults = dict(_flat(Config().model_dump(mode="json")))
    return [
        (key, json.dumps(value), json.dumps(defaults[key]) if key in defaults else "none")
        for key, value in _flat(config.model_dump(mode="json"))
        if value != defaults.get(key)
    ]


def records(story: Story) -> list[tuple[str, list[tuple[str, str]]]]:
    """Every record of metadata but the configuration, and what the recording holds: names with keys and values."""
    recording = story.recording
    counts = Counter(recorded.topic for recorded in recording.messages)
    held = [(topic, counted(count, "message")) for topic, count in sorted(counts.items())]
    if story.frames:
        held.append(("pictures", str(len(story.frames))))
    held += [(name, f"{len(data)} bytes") for name, data in recording.attachments.items()]
    said = [(name, list(record.items())) for name, record in recording.metadata.items() if name != "config"]
    return [*said, ("contents", held)]


def _recorded_at(story: Story, begin_ns: int) -> str:
    """The date at which the task began, where the recording says it."""
    session = story.recording.metadata.get("session", {})
    with suppress(KeyError, ValueError, OverflowError, OSError):
        begun_ns = int(session["anchor_unix_ns"]) + begin_ns - int(session["anchor_stamp_ns"])
        return f"from {datetime.fromtimestamp(begun_ns // 1_000_000_000, UTC):%Y-%m-%d %H:%M:%S} UTC"
    return "date not recorded"


def _digests(story: Story) -> str:
    """The first candidates with the beginnings of their models' digests."""
    said = [f"{story.models[k].name} {story.models[k].digest[:8]}" for k in story.ranking[:NAMED]]
    others = len(story.models) - NAMED
    return ", ".join([*said, f"and {others} more"] if others > 0 else said)


def _platform(build: Mapping[str, str]) -> str:
    """Python, numpy and the processor."""
    known = [f"Python {build['python']}"] if "python" in build else []
    known += [f"numpy {build['numpy']}"] if "numpy" in build else []
    return ", ".join([*known, build.get("processor", "processor not recorded")])


def _without_none(table: dict[str, Any]) -> dict[str, Any]:
    """TOML has no word for nothing."""
    return {
        key: _without_none(value) if isinstance(value, dict) else _rows_without_none(value)
        for key, value in table.items()
        if value is not None
    }


def _rows_without_none(value: Any) -> Any:
    return [_without_none(row) if isinstance(row, dict) else row for row in value] if isinstance(value, list) else value


def _flat(table: dict[str, Any], path: str = "") -> Iterator[tuple[str, Any]]:
    for key, value in table.items():
        if isinstance(value, dict) and value:
            yield from _flat(value, f"{path}{key}.")
        else:
            yield f"{path}{key}", value
