"""The looks one by one, for stepping through them: what was seen, from where, and what was believed then."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from viewsep.account import percent
from viewsep.messages import CandidateEstimate
from viewsep.plots.snapshots import address, snapshots, spread
from viewsep.plots.story import Story
from viewsep.plots.telling import seen_from
from viewsep.plots.timeline import Axis, axis_of

STRIP = 24  # thumbnails that are shown at once
MOST = 500  # looks to step through


@dataclass(frozen=True, slots=True)
class Thumbnail:
    """A picture of the strip: the `source` of the image of look `number`, seen in `phase`; `words` describe it."""

    number: int
    phase: str
    source: str
    words: str


@dataclass(frozen=True, slots=True)
class Step:
    """Look `number`, at `percent` of the timeline. `picture` is an index, or -1; `pictured` the look it is of.

    `facts` are time, phase, view, travel and comparisons; `cells` hold rating, times the best one's, the probability
    where candidates have any, w0, w1, w2, spread and whether it has settled for every candidate, in the order of the
    final ranking. Where it is known how probable none of them is, that is a last row, its other cells empty.
    """

    number: int
    percent: float
    picture: int
    pictured: int
    facts: list[str]
    cells: list[list[str]]


@dataclass(frozen=True, slots=True)
class Steps:
    """The strip, the steps, and the sources of their pictures: `#look-N` for those in the strip."""

    strip: list[Thumbnail]
    steps: list[Step]
    pictures: list[str]

    def data(self) -> dict[str, Any]:
        """What the page's script works with."""
        return {"steps": [asdict(step) for step in self.steps], "pictures": self.pictures}


def steps_of(story: Story) -> Steps:
    """All looks, or an even choice of many, with as many pictures as a page should hold."""
    pictures = snapshots(story)
    places = sorted(pictures)
    shown = {places[i] for i in spread(len(places), STRIP)}
    strip = [_thumbnail(story, place, pictures[place]) for place in places if place in shown]
    sources = [f"#look-{place + 1}" if place in shown else address(pictures[place], "webp") for place in places]
    axis = axis_of(story)
    steps = [_step(story, look, places, axis) for look in spread(len(story.looks), MOST)]
    return Steps(strip, steps, sources)


def _thumbnail(story: Story, place: int, picture: bytes) -> Thumbnail:
    look = story.looks[place]
    words = f"Look {place + 1}, {look.phase.value}, from {seen_from(look.percept.view_direction)}"
    return Thumbnail(place + 1, look.phase.value, address(picture, "webp"), words)


def _step(story: Story, index: int, pictured: list[int], axis: Axis) -> Step:
    """The step of the look at `index`; looks without a picture show the one before."""
    look = story.looks[index]
    before = bisect_right(pictured, index) - 1
    estimates = look.belief.estimate.candidates
    best = min(candidate.rating for candidate in estimates)
    unknown = look.belief.estimate.unknown
    return Step(
        number=index + 1,
        percent=axis.percent(look.percept.stamp_ns),
        picture=before,
        pictured=pictured[before] + 1 if pictured else 0,
        facts=[
            f"{axis.seconds(look.percept.stamp_ns):.1f} s",
            look.phase.value,
            seen_from(look.percept.view_direction),
            f"{np.degrees(look.travel_rad):.0f}°",
            str(look.belief.estimate.comparisons),
        ],
        cells=[
            *(_cells(estimates[k], best, story.has_probabilities) for k in story.ranking),
            *([["", "", "" if unknown is None else percent(unknown), *[""] * 5]] if len(story.unknown) else []),
        ],
    )


def _cells(candidate: CandidateEstimate, best: float, rated: bool) -> list[str]:
    spread_deg = np.degrees(np.sqrt(candidate.variance))
    probability = "" if candidate.probability is None else percent(candidate.probability)
    return [
        f"{candidate.rating:.3g}",
        f"{candidate.rating / best:.1f}",
        *([probability] if rated else []),
        f"{candidate.w0:.3f}",
        f"{np.degrees(candidate.w1):.1f}°",
        f"{candidate.w2:.3f}",
        f"{spread_deg:.1f}°" if np.isfinite(spread_deg) else "unknown",
        "yes" if candidate.converged else "no",
    ]
