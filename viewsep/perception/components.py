"""From what differs to one object: specks removed, gaps closed, the largest plausible piece, holes filled."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from viewsep.messages import Array

OPENING = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (5, 5))
RIM = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))  # differences are seen in smoothed pictures, a pixel too wide
LINE = np.ones((9, 9), np.uint8)  # closes the breaks of a thin line
ROOM_PX = 2 * 9
CLOSING = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9))  # gaps up to about this width are closed
FAR_OFF = 0.5  # what a piece as far off as the picture is wide counts for


@dataclass(frozen=True, eq=False, slots=True)
class Component:
    """The chosen piece: `mask` (h, w) uint8 with 1 on it, its `area` in pixels.

    `rival` is the area of all other pieces together as a share of its own.
    """

    mask: Array
    area: int
    rival: float


def largest_plausible(
    differs: Array,
    bridge: Array | None = None,
    near: tuple[float, float] | None = None,
    shade: Array | None = None,
) -> Component:
    """The largest piece of an (h, w) uint8 picture of what differs, those far from `near` (x, y) counting for less.

    Pieces that touch `bridge`, an (h, w) bool mask of what may hide a part of the object, belong together. The holes of
    the piece are filled, and so are sides that look like the ground where thin lines go round them, or like the ground
    in shadow, `shade` (h, w) uint8: its own shadow lies beside an object. Nothing makes an empty one.
    """
    clean = cv2.erode(cv2.morphologyEx(differs, cv2.MORPH_OPEN, OPENING), RIM)
    if bridge is not None:
        clean = _joined(clean, bridge)
    closed = _closed(clean)
    found, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outlines: Sequence[Array] = found
    mask = np.zeros_like(closed)
    if not outlines:
        return Component(mask, 0, 0.0)
    areas = np.array([cv2.contourArea(outline) for outline in outlines])
    best = int(np.argmax(areas * _nearness(outlines, near, max(mask.shape))))
    cv2.drawContours(mask, outlines, best, 1, cv2.FILLED)
    piece = _piece(outlines[best], mask.shape)
    moved = outlines[best] - np.array([piece[1].start, piece[0].start], np.int32)
    mask[piece] = _with_sides(mask[piece], moved, differs[piece] if shade is None else differs[piece] | shade[piece])
    others = np.delete(areas, best)
    rival = float(others.sum() / max(areas[best], 1.0))
    return Component(mask, int(cv2.countNonZero(mask)), rival)


def _piece(outline: Array, shape: tuple[int, ...]) -> tuple[slice, slice]:
    """The rows and columns around an outline, with room for what is closed beside it."""
    left, top, width, height = cv2.boundingRect(outline)
    return (
        slice(max(0, top - ROOM_PX), min(shape[0], top + height + ROOM_PX)),
        slice(max(0, left - ROOM_PX), min(shape[1], left + width + ROOM_PX)),
    )


def _with_sides(mask: Array, outline: Array, differs: Array) -> Array:
    """The piece with what its hull holds and thin lines enclose, which are too thin to be pieces themselves.

    A side of an object that has the ground's colour shows its edges only; the ground within the hull shows none around.
    """
    hull = np.zeros_like(mask)
    cv2.drawContours(hull, [cv2.convexHull(outline)], -1, 1, cv2.FILLED)
    within: Array = differs & hull
    lines = cv2.morphologyEx(within, cv2.MORPH_CLOSE, LINE) | mask
    outlines, _ = cv2.findContours(lines, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    enclosed = np.zeros_like(mask)
    cv2.drawContours(enclosed, outlines, -1, 1, cv2.FILLED)
    beside: Array = enclosed & hull & ~mask
    sides = cv2.morphologyEx(beside, cv2.MORPH_OPEN, OPENING)
    return np.asarray(cv2.morphologyEx(sides | mask, cv2.MORPH_CLOSE, RIM))


def _closed(clean: Array) -> Array:
    """Gaps closed, but nothing grows onto the border: what is there was there before."""
    closed: Array = np.asarray(cv2.morphologyEx(clean, cv2.MORPH_CLOSE, CLOSING))
    for edge in (np.s_[0], np.s_[-1], np.s_[:, 0], np.s_[:, -1]):
        closed[edge] = clean[edge]
    return closed


def _joined(clean: Array, bridge: Array) -> Array:
    """`clean` with those pieces of the bridge that lie between two pieces of it, or within one."""
    across = cv2.morphologyEx(clean, cv2.MORPH_CLOSE, np.ones((1, 2 * _width(bridge) + 1), np.uint8))
    return np.where(bridge, across, clean)


def _width(bridge: Array) -> int:
    """The most columns of one row that the bridge covers, as far as closing across it makes sense."""
    return int(min(bridge.sum(axis=1, dtype=np.int32).max(initial=0), bridge.shape[1] // 4))


def _nearness(outlines: Sequence[Array], near: tuple[float, float] | None, size: int) -> Array:
    """(N,) from 1 at `near` down to FAR_OFF."""
    if near is None:
        return np.ones(len(outlines))
    middles = np.array([outline.reshape(-1, 2).mean(axis=0) for outline in outlines])
    away = np.minimum(np.hypot(*(middles - near).T) / size, 1.0)
    return np.asarray(1.0 - (1.0 - FAR_OFF) * away)
