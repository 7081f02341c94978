"""What the object looked like in coarse cells, and which of it turning does not explain: something that joined it.

A rigid object that turns by an angle a moves no point by more than 2 R sin(a / 2), R its radius, and sides that come
into sight are no wider than 2 R sin(a). A wider piece that was not shown that near a look before is no part of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from viewsep.messages import Array, BoolArray, FloatArray
from viewsep.perception.boxes import Box
from viewsep.perception.light import scaled

ACROSS = 20  # cells across the object's radius
COARSEST, FINEST = 0.7, 1.6  # times that many, until other cells are taken
TOLERANCE, TOLERANCE_SHARE = 20.0, 0.12  # grey levels, and of how bright it is: sides turn to and from the light
SHAKE_CELLS = 0.5
BESIDE, ALIKE = (3, 3), 0.6  # cells around one, and how many of them must be alike as well
LOOK_AT = (3, 6, 12, 24, 48)  # steps
HALF = 128  # of 255: from there on a cell is the object's


@dataclass(frozen=True, eq=False, slots=True)
class Appearance:
    """The object in square cells of `cell_px`, which begin at the picture's corner.

    `box` holds it, in cells; `colours` (h, w, 4) uint8 are those of its own pixels with 255 behind them, all zero where
    it is not; `light` (3,) or None is the ground's. `radius_px` is that of the circle around it.
    """

    cell_px: int
    box: Box
    colours: Array
    light: FloatArray | None
    radius_px: float

    @property
    def on(self) -> BoolArray:
        """(h, w), True on the object."""
        return np.asarray(self.colours[..., 3] > 0)

    def without(self, piece: Piece) -> Appearance:
        """The same with a piece and the cells around it cut out."""
        colours = self.colours.copy()
        colours[placed(piece.grown(1), self.box)] = 0
        return Appearance(self.cell_px, self.box, colours, self.light, self.radius_px)


@dataclass(frozen=True, eq=False, slots=True)
class Piece:
    """Cells (h, w) bool in a box of cells, and what was seen there in this light."""

    cells: BoolArray
    box: Box
    colours: Array
    light: FloatArray | None

    def grown(self, by: int) -> Piece:
        """Larger by some cells on all sides."""
        cells = cv2.dilate(np.pad(self.cells, by).view(np.uint8), np.ones((2 * by + 1, 2 * by + 1), np.uint8)) > 0
        box = Box(self.box.left - by, self.box.top - by, self.box.right + by, self.box.bottom + by)
        return Piece(np.asarray(cells), box, np.pad(self.colours, ((by, by), (by, by), (0, 0))), self.light)


def appearance(
    image: Array, mask: Array, box: Box, light: FloatArray | None, cell_px: int | None = None
) -> Appearance | None:
    """Of the object with this `mask` (h, w) uint8 0 and 1 in a box of a picture (H, W, 3); None where it is too small.

    Cells are of `cell_px` unless the object has become too large or too small for that.
    """
    left, top, width, height = cv2.boundingRect(mask)
    guess = cell_px or max(2, round(np.hypot(width, height) / 2 / ACROSS))
    seen = _in_cells(image, mask, Box(left, top, left + width, top + height), box, light, guess)
    if seen is None or cell_px is None or COARSEST * ACROSS <= seen.radius_px / cell_px <= FINEST * ACROSS:
        return seen
    return seen if cell_px == 2 and seen.radius_px < cell_px * ACROSS else appearance(image, mask, box, light)


def unexplained(
    now: Appearance,
    before: Appearance,
    reach_cells: float,
    shift: tuple[int, int] = (0, 0),
    across: int = 1,
    alike: float = ALIKE,
) -> BoolArray:
    """(h, w) of `now.box`: cells of the object that `before` did not show within reach, moved by `shift` (x, y).

    A cell was shown if it and `alike` of those around it were, all moved the same way, as single colours are found
    anywhere. Only those in discs of `across` cells are of interest, so that the search may end once there are none.
    """
    room = int(np.ceil(reach_cells))
    height, width = now.on.shape
    known = _around(_lit(before.colours, now.light, before.light), before.box, now.box, room, shift)
    low, high = _allowed(now.colours)
    on: Array = now.on.view(np.uint8)
    missing, enough = on, np.ceil(alike * _beside(on)).astype(np.uint8)
    for number, (dy, dx) in enumerate(_nearest_first(reach_cells), start=1):
        there = known[room + dy : room + dy + height, room + dx : room + dx + width]
        shown = np.asarray(cv2.inRange(there, low, high)) & on
        missing = missing & ~(shown & (_beside(shown) >= enough))
        if number in LOOK_AT and not opened(missing > 0, across).any():
            break
    return np.asarray(missing > 0)


def opened(cells: BoolArray, across: int) -> BoolArray:
    """Those cells (h, w) that lie in a disc of so many cells across which is all set."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (across, across))
    wide = cv2.copyMakeBorder(cells.view(np.uint8), across, across, across, across, cv2.BORDER_CONSTANT)
    inner = cv2.morphologyEx(wide, cv2.MORPH_OPEN, disc)[across:-across, across:-across]
    return np.asarray(inner > 0)


def placed(piece: Piece, box: Box) -> BoolArray:
    """The piece's cells in another box of cells, (h, w) bool."""
    found = np.zeros((box.bottom - box.top, box.right - box.left), bool)
    top, left = max(piece.box.top, box.top), max(piece.box.left, box.left)
    bottom, right = min(piece.box.bottom, box.bottom), min(piece.box.right, box.right)
    if top < bottom and left < right:
        found[top - box.top : bottom - box.top, left - box.left : right - box.left] = piece.cells[
            top - piece.box.top : bottom - piece.box.top, left - piece.box.left : right - piece.box.left
        ]
    return found


def still_there(piece: Piece, now: Appearance, room: int = 2) -> tuple[float, tuple[int, int]]:
    """Which share of a piece looks as it did, moved by up to `room` cells (x, y) as in a hand, and by how many."""
    height, width = piece.cells.shape
    known = _around(now.colours, now.box, piece.box, room, (0, 0))
    low, high = _allowed(_lit(piece.colours, now.light, piece.light))
    shares = {}
    for dy, dx in _nearest_first(float(room)):
        there = known[room + dy : room + dy + height, room + dx : room + dx + width]
        shares[dx, dy] = float((cv2.inRange(there, low, high)[piece.cells] > 0).mean())
    where = max(shares, key=lambda step: shares[step])  # the nearest of the best
    return shares[where], where


def _in_cells(
    image: Array, mask: Array, inner: Box, box: Box, light: FloatArray | None, cell_px: int
) -> Appearance | None:
    """`inner` holds the mask, in pixels of the box."""
    height, width = (length // cell_px for length in image.shape[:2])
    left, top = (box.left + inner.left) // cell_px, (box.top + inner.top) // cell_px
    right = min(width, -(-(box.left + inner.right) // cell_px))
    bottom = min(height, -(-(box.top + inner.bottom) // cell_px))
    if right <= left or bottom <= top:
        return None
    cells = Box(left, top, right, bottom)
    part = np.s_[top * cell_px : bottom * cell_px, left * cell_px : right * cell_px]
    on = np.zeros(((bottom - top) * cell_px, (right - left) * cell_px), np.uint8)
    row, column = box.top + inner.top - top * cell_px, box.left + inner.left - left * cell_px
    own = mask[inner.part][: on.shape[0] - row, : on.shape[1] - column]
    on[row : row + own.shape[0], column : column + own.shape[1]] = own * np.uint8(255)
    size = (right - left, bottom - top)
    alone = cv2.bitwise_and(image[part], image[part], mask=on)
    share = cv2.resize(on, size, interpolation=cv2.INTER_AREA)
    mean = cv2.resize(alone, size, interpolation=cv2.INTER_AREA).astype(np.float32)
    mean *= (255.0 / np.maximum(share, HALF).astype(np.float32))[..., None]
    held: Array = share >= HALF
    if not held.any():
        return None
    colours = np.zeros((*held.shape, 4), np.uint8)
    colours[held, :3] = np.minimum(mean[held], 255.0)
    colours[held, 3] = 255
    outlines, _ = cv2.findContours(held.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    _, radius = cv2.minEnclosingCircle(np.concatenate(outlines))
    return Appearance(cell_px, cells, colours, light, (radius + 0.5) * cell_px)


def _around(colours: Array, own: Box, box: Box, room: int, shift: tuple[int, int]) -> Array:
    """Colours (h, w, 4) of the cells of `own` in a box of cells grown by `room`, all moved by `shift` (x, y)."""
    height, width = box.bottom - box.top + 2 * room, box.right - box.left + 2 * room
    known = np.zeros((height, width, 4), np.uint8)
    top, left = own.top + shift[1] - box.top + room, own.left + shift[0] - box.left + room
    rows, columns = colours.shape[:2]
    inside = np.s_[max(0, top) : max(0, top + rows), max(0, left) : max(0, left + columns)]
    there = known[inside]
    there[:] = colours[max(0, -top) :, max(0, -left) :][: there.shape[0], : there.shape[1]]
    return known


def _lit(colours: Array, now: FloatArray | None, before: FloatArray | None) -> Array:
    """Colours (h, w, 4) as they are in another light (3,); the same where one of the two is not known."""
    if now is None or before is None:
        return colours
    return scaled(colours, np.append(np.clip(now / np.maximum(before, 1e-6), 0.5, 2.0), 1.0))


def _allowed(colours: Array) -> tuple[Array, Array]:
    """The darkest and the brightest (h, w, 4) uint8 that count as alike."""
    low = scaled(colours, np.full(4, 1.0 - TOLERANCE_SHARE), -TOLERANCE)
    high = scaled(colours, np.full(4, 1.0 + TOLERANCE_SHARE), TOLERANCE)
    low[..., 3] = high[..., 3] = 255
    return low, high


def _beside(cells: Array) -> Array:
    """(h, w) uint8: how many of the cells there and around are set."""
    return np.asarray(cv2.boxFilter(cells, -1, BESIDE, normalize=False, borderType=cv2.BORDER_CONSTANT))


@lru_cache(maxsize=64)
def _nearest_first(reach: float) -> tuple[tuple[int, int], ...]:
    """Steps (y, x) within reach."""
    room = int(np.ceil(reach))
    steps = [(y, x) for y in range(-room, room + 1) for x in range(-room, room + 1) if np.hypot(y, x) <= reach + 1e-9]
    return tuple(sorted(steps, key=lambda step: (np.hypot(*step), step)))
