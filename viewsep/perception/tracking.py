"""Where the object was, how large, and where to look for it next."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from viewsep.perception.boxes import Box, whole
from viewsep.perception.joining import Memory

GROWTH = 0.15  # of the object's larger side, on every side
LEAST_GROWTH_PX = 12
REMEMBERED = 5  # areas
CREDIBLE_AFTER = 5  # figures in a row that are all refused, but alike: the object is another one, or held otherwise


@dataclass(frozen=True, slots=True)
class Sighting:
    """A figure's area in pixels, at joint angles (n,) radians."""

    area: int
    joints: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Track:
    """What is remembered from picture to picture; `Track()` knows nothing.

    `box` is where the object was last, `seen` are the last good figures, `doubted` those refused since. `memory` is of
    what it looked like.
    """

    box: Box | None = None
    seen: tuple[Sighting, ...] = ()
    doubted: tuple[Sighting, ...] = ()
    memory: Memory = field(default_factory=Memory)

    def after(self, box: Box | None, area: int, joints: tuple[float, ...], good: bool, memory: Memory) -> Track:
        """The track with one more figure; a bad one is no place to look for the next."""
        sighting = Sighting(area, joints)
        if good:
            return Track(box, (*self.seen, sighting)[-REMEMBERED:], memory=memory)
        doubted = (*self.doubted, sighting)[-CREDIBLE_AFTER:] if area else ()
        return replace(self, box=None, doubted=doubted, memory=memory)


def region_of_interest(track: Track, shape: tuple[int, int]) -> Box:
    """The part of a picture of `shape` (H, W) in which the object must be unless it has moved; all where unknown."""
    if track.box is None:
        return whole(shape)
    box = track.box
    side = max(box.right - box.left, box.bottom - box.top)
    return box.grown(max(LEAST_GROWTH_PX, round(GROWTH * side)), shape)


def turned(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    """By how much the joints moved, radians: the most any of them did, at most half a turn."""
    if len(a) != len(b) or not a:
        return float(np.pi) if len(a) != len(b) else 0.0
    return float(min(np.max(np.abs(np.subtract(a, b))), np.pi))
