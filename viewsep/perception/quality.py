"""How far a mask can be trusted: a score, and what is wrong with it in words."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from viewsep.messages import Array
from viewsep.perception.boxes import Box
from viewsep.perception.components import Component
from viewsep.perception.tracking import CREDIBLE_AFTER, Sighting, Track, turned

ACROSS_PX = 3  # how far inside and outside of the outline colours are compared
OUTLINE_POINTS = 160
SEEN_GREY_LEVELS = 10.0  # a smaller difference across the outline is none
NOTHING = "no object stands out from the background: is it in the picture?"
GONE = "the object is gone, no object stands out from the background any more: put it back"
GROWS_PER_RAD = 3.0  # how much the log of an object's area may change while it turns


@dataclass(frozen=True, slots=True)
class Limits:
    """Where a mask stops being good.

    Shares of the picture's area; `border_share` of the outline that lies on the picture's border; `area_jump` by which
    the area may change between two looks at about the same view; `contrast_share` of the outline across which colours
    must differ; `rival_share` of the object's area that other pieces may have.
    """

    smallest_share: float = 0.003
    largest_share: float = 0.6
    border_share: float = 0.01
    area_jump: float = 1.35
    contrast_share: float = 0.6
    rival_share: float = 0.12


@dataclass(frozen=True, slots=True)
class Quality:
    """`score` 0 to 1: good from 0.5 on. The single scores, by what they judge, and the sentence for the worst.

    `absent` says that nothing stands out at all.
    """

    score: float
    parts: dict[str, float]
    problem: str = ""
    absent: bool = False

    @property
    def comparable(self) -> bool:
        """Whether the mask is good but for its area, so that it can be compared with the look before."""
        return not self.absent and all(score >= 0.5 for name, score in self.parts.items() if name != "area")

    def joined(self, share: float) -> Quality:
        """The same of a mask this share of which is something that has come before the object; 0 for none."""
        score = min(0.49, 1.0 - share) if share > 0 else 1.0
        problem = (
            f"something has joined the object or come before it: {share:.0%} of what stands out is new, which turning "
            "does not explain; take it away, or begin again if it is the object itself"
        )
        parts = {**self.parts, "joined": score}
        if score >= self.score:
            return replace(self, parts=parts)
        return Quality(score, parts, problem)


def judge(image: Array, found: Component, box: Box, joints: tuple[float, ...], track: Track, limits: Limits) -> Quality:
    """Judge what was found in the box of a picture (H, W, 3)."""
    share = found.area / (image.shape[0] * image.shape[1])
    if share < limits.smallest_share:
        parts = {"size": _above(share, limits.smallest_share)}
        return Quality(parts["size"], parts, GONE if track.seen else NOTHING, absent=True)
    outline = _outline(found.mask) + np.array([box.left, box.top])
    on_border = _on_border(outline, image.shape)
    jump = area_jump(Sighting(found.area, joints), track)
    contrast = contrast_share(image, outline)
    parts = {
        "size": min(_above(share, limits.smallest_share), _below(share, limits.largest_share)),
        "border": _below(on_border, limits.border_share),
        "area": _below(jump, float(np.log(limits.area_jump))),
        "contrast": _above(contrast, limits.contrast_share),
        "rival": _below(found.rival, limits.rival_share),
    }
    said = {
        "size": f"what stands out covers {share:.0%} of the picture: is something before the camera?",
        "border": f"{on_border:.0%} of the object's outline is the picture's border: it is not all in the picture",
        "area": f"the object's area changed by a factor of {np.exp(jump):.1f} more than turning it explains",
        "contrast": f"only {contrast:.0%} of the object's outline is seen in the picture: light or background changed?",
        "rival": f"other things stand out as well, {found.rival:.0%} as large as the object, or it is in pieces",
    }
    worst = min(parts, key=lambda name: parts[name])
    return Quality(parts[worst], parts, said[worst] if parts[worst] < 0.5 else "")


def area_jump(now: Sighting, track: Track) -> float:
    """By how much the log of the area changed beyond what turning explains, against the last good looks; 0 at first.

    After enough refused looks in a row that agree with this one, it is believed.
    """
    if not track.seen:
        return 0.0
    if len(track.doubted) == CREDIBLE_AFTER and all(_excess(now, before) < 0.1 for before in track.doubted):
        return 0.0
    return min(_excess(now, before) for before in track.seen)


def contrast_share(image: Array, outline: Array) -> float:
    """The share of the outline (N, 2) of x, y across which the picture's colours differ."""
    if len(outline) < 8:
        return 0.0
    chosen = np.linspace(0, len(outline) - 1, min(len(outline), OUTLINE_POINTS)).astype(int)
    points = outline[chosen]
    along = (outline[(chosen + 4) % len(outline)] - outline[chosen - 4]).astype(np.float32)
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.maximum(np.hypot(*along.T), 1e-3)[:, None]
    across = np.rint(np.concatenate([points + ACROSS_PX * normal, points - ACROSS_PX * normal])).astype(int)
    outside, inside = np.split(_mean3(image, across), 2)
    difference = np.abs(outside - inside).max(axis=1)
    return float((difference > SEEN_GREY_LEVELS).mean())


def _mean3(image: Array, points: Array) -> Array:
    """(N, 3) mean colour of 3 x 3 pixels around points (N, 2) of x, y."""
    height, width = image.shape[:2]
    offsets = np.array([[-1], [0], [1]])
    columns, rows = np.clip(points[:, 0] + offsets, 0, width - 1), np.clip(points[:, 1] + offsets, 0, height - 1)
    around = (rows[:, None] * width + columns).reshape(-1, len(points))  # (9, N)
    colours = np.take(image.reshape(-1, 3), around, axis=0)
    mean: Array = colours.sum(axis=0, dtype=np.float32) / np.float32(len(around))
    return mean


def _excess(now: Sighting, before: Sighting) -> float:
    change = abs(float(np.log(max(now.area, 1) / max(before.area, 1))))
    return max(0.0, change - GROWS_PER_RAD * turned(now.joints, before.joints))


def _outline(mask: Array) -> Array:
    """(N, 2) of x, y: the longest outline of a mask (h, w) uint8; parts that a holder hides are left out."""
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    longest = max(outlines, key=len, default=np.empty((0, 1, 2), np.int32))
    return np.asarray(longest.reshape(-1, 2))


def _on_border(outline: Array, shape: tuple[int, ...]) -> float:
    if len(outline) == 0:
        return 0.0
    x, y = outline.T
    return float(((x == 0) | (y == 0) | (x == shape[1] - 1) | (y == shape[0] - 1)).mean())


def _above(value: float, limit: float) -> float:
    """0.5 at the limit, towards 1 above it."""
    return value / (value + limit) if value > 0 else 0.0


def _below(value: float, limit: float) -> float:
    """0.5 at the limit, 1 at zero."""
    return limit / (limit + value)
