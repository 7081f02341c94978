"""Whether something has come before the object, or joined it: noticed when it comes, known as long as it stays."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from viewsep.messages import Array, BoolArray, FloatArray
from viewsep.perception.appearance import (
    SHAKE_CELLS,
    Appearance,
    Piece,
    appearance,
    opened,
    placed,
    still_there,
    unexplained,
)
from viewsep.perception.boxes import Box

LEAST = 1.0 / 3.0  # of the root of the object's area: how wide a piece is at least that spoils a mask
PARTLY_CELLS = 1.5  # that are of a new side at its two ends
STAYS = 0.5  # of a piece that still looks as it did
MOST = 0.5  # of the figure that may be foreign: if more is new, the object is another one, or held otherwise, ...
OTHERWISE = 0.12  # ... as it is if so much of the rest has changed, too
DEEPEST = 3.0  # times as deep as it is wide an object may be of which one view is known
AWAY = 3  # looks in a row that show no object: whatever was there is gone


@dataclass(frozen=True, eq=False, slots=True)
class Memory:
    """What the object looked like last, at joint angles (n,) radians; `Memory()` knows nothing.

    `radius_px` is the largest so far, `least` and `most` (n,) the joints' range so far. `piece` is what has joined it.
    `away` counts looks without any object.
    """

    last: Appearance | None = None
    joints: tuple[float, ...] = ()
    radius_px: float = 0.0
    least: tuple[float, ...] = ()
    most: tuple[float, ...] = ()
    piece: Piece | None = None
    away: int = 0

    def missing(self) -> Memory:
        """The memory with one more look that shows no object."""
        return Memory() if self.away + 1 >= AWAY else replace(self, away=self.away + 1)

    def turned(self, joints: tuple[float, ...]) -> float:
        """By how much the object turned since, radians, at most: half a turn where nobody knows."""
        if len(joints) != len(self.joints):
            return float(np.pi)
        return float(min(np.abs(np.subtract(joints, self.joints)).sum(), np.pi))

    def reach_px(self, known_px: float) -> float:
        """The radius of the object, whatever depth it may have that has not been seen yet."""
        if known_px:
            return max(known_px, self.radius_px)
        seen = max(np.subtract(self.most, self.least), default=0.0)
        return float(self.radius_px / max(np.sin(min(seen, np.pi / 2)), 1.0 / DEEPEST))

    def after(self, seen: Appearance, joints: tuple[float, ...], piece: Piece | None) -> Memory:
        """With one more look, in which there is this foreign piece."""
        if piece is not None:
            return replace(self, last=seen.without(piece), joints=joints, piece=piece, away=0)
        known = len(joints) == len(self.least)
        return Memory(
            seen,
            joints,
            max(self.radius_px, seen.radius_px),
            tuple(np.minimum(self.least, joints).tolist()) if known else joints,
            tuple(np.maximum(self.most, joints).tolist()) if known else joints,
        )


@dataclass(frozen=True, eq=False, slots=True)
class Joining:
    """What one look says: `share` of the figure that is foreign, 0 for none, and `memory` with it."""

    share: float
    memory: Memory


def look_for_joining(
    image: Array,
    mask: Array,
    box: Box,
    light: FloatArray | None,
    joints: tuple[float, ...],
    memory: Memory,
    known_px: float = 0.0,
) -> Joining:
    """Compare the figure, its mask (h, w) uint8 in a box of a picture, with the look before.

    `known_px` is the radius of the object's bounding sphere, 0 where that is not known.
    """
    seen = appearance(image, mask, box, light, None if memory.last is None else memory.last.cell_px)
    if seen is None:
        return Joining(0.0, memory)
    piece = _foreign(seen, joints, memory, known_px)
    share = 0.0 if piece is None else float(piece.cells.sum() / max(seen.on.sum(), 1))
    return Joining(share, memory.after(seen, joints, piece))


def _foreign(seen: Appearance, joints: tuple[float, ...], memory: Memory, known_px: float) -> Piece | None:
    last, cell_px = memory.last, seen.cell_px
    if last is None or last.cell_px != cell_px:
        return None
    if memory.piece is not None:
        share, (x, y) = still_there(memory.piece, seen)
        if share >= STAYS:
            old = memory.piece.box
            return replace(memory.piece, box=Box(old.left + x, old.top + y, old.right + x, old.bottom + y))
    angle, radius = memory.turned(joints), memory.reach_px(known_px) / cell_px
    reach = float(np.ceil(4.0 * radius * np.sin(angle / 2.0)) / 2.0) + SHAKE_CELLS
    widest = 2.0 * radius * np.sin(min(angle, np.pi / 2.0))
    across = int(np.ceil(max(widest + PARTLY_CELLS, LEAST * np.sqrt(seen.on.sum()), 3.0)))
    if across > min(seen.on.shape):  # anything may have come into sight
        return None
    cells = _new(seen, last, reach, across, memory.piece, (0, 0))
    if cells is None or _new(seen, last, reach, across, memory.piece, _moved(seen, last)) is None:
        return None
    return Piece(cells, seen.box, seen.colours, seen.light)


def _new(
    seen: Appearance, last: Appearance, reach: float, across: int, piece: Piece | None, shift: tuple[int, int]
) -> BoolArray | None:
    """The cells of `seen` that have come before the object, if any; None also where all of it is otherwise."""
    changed = unexplained(seen, last, reach, shift, across)
    room = int(np.ceil(reach)) + 1
    if piece is not None:  # what has come into sight behind it
        changed &= ~placed(piece.grown(room), seen.box)
    new = opened(changed, across)
    if not new.any() or new.sum() > MOST * seen.on.sum():
        return None
    beside = Piece(new, seen.box, seen.colours, seen.light).grown(room)
    back = (-shift[0], -shift[1])
    for a, b, by in ((seen, last, shift), (last, seen, back)):
        rest = a.on & ~placed(beside, a.box)
        if (unexplained(a, b, reach, by, alike=0.0) & rest).sum() > OTHERWISE * rest.sum():
            return None
    return new


def _moved(seen: Appearance, last: Appearance) -> tuple[int, int]:
    """By how many cells (x, y) the middle of the object moved."""
    a, b = seen.box, last.box
    return round((a.left + a.right - b.left - b.right) / 2), round((a.top + a.bottom - b.top - b.bottom) / 2)
