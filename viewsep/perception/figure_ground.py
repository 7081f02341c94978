"""Which part of a picture is the object: the interface, and how its steps follow each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol

import cv2
import numpy as np

from viewsep.errors import BadInput
from viewsep.messages import Array, BoolArray, FloatArray
from viewsep.perception.boxes import Box, around, whole
from viewsep.perception.components import Component, largest_plausible
from viewsep.perception.ground import Difference, Ground
from viewsep.perception.holder import Holder
from viewsep.perception.joining import look_for_joining
from viewsep.perception.quality import Limits, Quality, judge
from viewsep.perception.tracking import Track, region_of_interest


@dataclass(frozen=True, eq=False, slots=True)
class Figure:
    """The object in one picture.

    `mask` (H, W) bool, True on the object; `quality` says how far it can be trusted; `problem` is empty, or a sentence
    that says why it cannot: such a mask makes no percept. `track` is to be given with the next picture. `light` (3,) is
    how bright the ground is by channel, None where nobody knows.
    """

    mask: BoolArray
    quality: Quality
    problem: str
    track: Track
    light: FloatArray | None = None


class FigureGround(Protocol):
    """Finds the object in pictures that follow each other."""

    def segment(self, image: Array, joints: Sequence[float], track: Track) -> Figure:
        """The object in an (H, W, 3) uint8 RGB picture taken at joint angles (n,), radians.

        `track` is the figure's before, or `Track()`. Raises BadInput for pictures of another size than expected.
        """
        ...


@dataclass(frozen=True, slots=True)
class Segmenter:
    """`FigureGround` by what differs from the ground: the largest plausible piece of it, holes filled, and judged.

    The search begins around where the object was; where that shows no whole object, all of the picture is searched.
    `radius_px` is that of the object's bounding sphere, 0 where it is not known.
    """

    ground: Ground
    holder: Holder | None = None
    limits: Limits = field(default_factory=Limits)
    radius_px: float = 0.0

    def segment(self, image: Array, joints: Sequence[float], track: Track) -> Figure:
        """The object in the picture, as `FigureGround` says."""
        if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
            raise BadInput(f"a picture is {image.shape} {image.dtype}; figure-ground takes (H, W, 3) uint8 RGB")
        shape = (image.shape[0], image.shape[1])
        box = region_of_interest(track, shape)
        found, ground = self._search(image, joints, box, track)
        if box != whole(shape) and (ground.problem or _cut_off(found, box, shape)):
            box = whole(shape)
            found, ground = self._search(image, joints, box, track)
        mask = np.zeros(shape, bool)
        mask[box.part] = found.mask > 0
        quality = judge(image, found, box, tuple(joints), track, self.limits)
        memory = track.memory
        if quality.absent:
            memory = memory.missing()
        elif not ground.problem and quality.comparable:
            joining = look_for_joining(image, found.mask, box, ground.light, tuple(joints), memory, self.radius_px)
            quality, memory = quality.joined(joining.share), joining.memory
        problem = ground.problem or quality.problem
        return Figure(
            mask,
            quality,
            problem,
            track.after(_shifted(around(found.mask), box), found.area, tuple(joints), not problem, memory),
            None if ground.problem else ground.light,
        )

    def _search(self, image: Array, joints: Sequence[float], box: Box, track: Track) -> tuple[Component, Difference]:
        """The object in the box, its mask (h, w), and the ground."""
        ground = self.ground.difference(image, joints, box)
        differs, held = ground.differs, None
        if self.holder is not None:
            held = self.holder.at(joints, image.shape[:2])[box.part]
            hidden = held if not self.ground.shows_holder else held & ~(differs > 0)
            differs = np.where(hidden, np.uint8(0), differs)
            held = hidden
        near = None if track.box is None else _middle(track.box, box)
        found = largest_plausible(differs, held, near, ground.shade)
        if held is not None:
            mask = np.where(held, np.uint8(0), found.mask)
            found = replace(found, mask=mask, area=int(cv2.countNonZero(mask)))
        return found, ground


def _shifted(inner: Box | None, box: Box) -> Box | None:
    """What lies in the pixels of the box, in those of the picture."""
    if inner is None:
        return None
    return Box(box.left + inner.left, box.top + inner.top, box.left + inner.right, box.top + inner.bottom)


def _middle(before: Box, box: Box) -> tuple[float, float]:
    """Where the object was (x, y), in the pixels of the box."""
    return (before.left + before.right) / 2 - box.left, (before.top + before.bottom) / 2 - box.top


def _cut_off(found: Component, box: Box, shape: tuple[int, int]) -> bool:
    """Whether the figure goes on beyond a side of the box that is no side of the picture, or is not there."""
    mask, (height, width) = found.mask, shape
    if found.area == 0:
        return True
    return bool(
        (box.top > 0 and mask[0].any())
        or (box.bottom < height and mask[-1].any())
        or (box.left > 0 and mask[:, 0].any())
        or (box.right < width and mask[:, -1].any())
    )
