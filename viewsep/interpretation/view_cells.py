"""The view sphere cut into small cells of about equal size, and what a model shows in each of them.

Six faces of a cube, each divided evenly in angle: a cell is found without a search, at the poles as elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from viewsep.messages import Array, FloatArray
from viewsep.models.aspect_graph import AspectGraph

PER_EDGE = 24  # cells along a face's edge: 3.75 degrees each
CELLS = 6 * PER_EDGE**2
_QUARTER = np.pi / 4.0
_RATIOS = 2048  # steps of the tangent from 0 to 1 in the table of slots


def cell_of(x: Array, y: Array, z: Array) -> Array:
    """Components (N,) of unit vectors -> (N,) int32 cells."""
    ax, ay, az = np.abs(x), np.abs(y), np.abs(z)
    largest = np.maximum(np.maximum(ax, ay), az)
    along_x = ax == largest
    along_y = (ay == largest) & ~along_x
    main, first, second = z.copy(), x.copy(), y.copy()
    for component, of_x, of_y in ((main, x, y), (first, y, z), (second, z, x)):
        np.putmask(component, along_y, of_y)
        np.putmask(component, along_x, of_x)
    face = 4 - 4 * along_x.view(np.int8) - 2 * along_y.view(np.int8) + (main < 0)
    scale = _RATIOS / largest
    column = _SLOTS.take((first * scale + _RATIOS).astype(np.int32))
    row = _SLOTS.take((second * scale + _RATIOS).astype(np.int32))
    cells: Array = (face * np.int32(PER_EDGE) + row) * PER_EDGE + column
    return cells


@cache
def cell_directions() -> FloatArray:
    """(CELLS, 3) the cells' middles, read-only."""
    face, row, column = np.unravel_index(np.arange(CELLS), (6, PER_EDGE, PER_EDGE))
    axis, sign = face // 2, 1.0 - 2.0 * (face % 2)
    middles = np.empty((CELLS, 3))
    index = np.arange(CELLS)
    middles[index, axis] = sign
    middles[index, (axis + 1) % 3] = np.tan(_angle(column))
    middles[index, (axis + 2) % 3] = np.tan(_angle(row))
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    middles.setflags(write=False)
    return middles


@cache
def cell_areas() -> FloatArray:
    """(CELLS,) shares of the sphere, read-only."""
    parts = np.abs(cell_directions())
    main = parts.max(axis=1)
    area = ((main**2)[:, None] + parts**2).prod(axis=1) / (2.0 * main**3)  # the main one gives 2 main^2
    shares: FloatArray = area / area.sum()
    shares.setflags(write=False)
    return shares


def _angle(slot: Array) -> FloatArray:
    angles: FloatArray = (slot + 0.5) * (2.0 * _QUARTER / PER_EDGE) - _QUARTER
    return angles


_SLOTS = np.clip(
    (np.arctan((np.arange(2 * _RATIOS + 1) + 0.5) / _RATIOS - 1.0) + _QUARTER) * (PER_EDGE / (2.0 * _QUARTER)),
    0,
    PER_EDGE - 1,
).astype(np.int32)


@dataclass(frozen=True, eq=False, slots=True)
class Interpolation:
    """What a model shows in each cell, as a mixture of up to three of its nodes.

    `node` (CELLS, 3) int32, `weight` (CELLS, 3) float32 summing to 1 where `covered` (CELLS,) bool: elsewhere the model
    has no view close enough, and the nearest node stands for it with weight 1.
    """

    node: Array
    weight: Array
    covered: Array

    @staticmethod
    def of(model: AspectGraph) -> Interpolation:
        """Barycentric in the graph's triangles, along the nearest edge where a cell lies in none of them."""
        middles, directions = cell_directions(), model.directions
        reach = 0.75 * _spacing(model)
        nearest = np.argmax(middles @ directions.T, axis=1)
        node = np.repeat(nearest[:, None], 3, axis=1).astype(np.int32)
        weight = np.zeros((CELLS, 3), np.float32)
        weight[:, 0] = 1.0
        distance = np.arccos(np.clip((middles * directions[nearest]).sum(axis=1), -1.0, 1.0))
        covered = distance <= reach
        on_edge, pairs, shares = _along_edges(middles, model)
        node[on_edge, :2], weight[on_edge, :2] = pairs, shares
        inside, corners, parts = _in_triangles(middles, model)
        node[inside], weight[inside] = corners, parts
        covered[inside] = True
        return Interpolation(node, weight, covered)


def _spacing(model: AspectGraph) -> float:
    """The mean angle between neighbours."""
    a, b = model.directions[model.edges].transpose(1, 0, 2)
    return float(np.arccos(np.clip((a * b).sum(axis=1), -1.0, 1.0)).mean())


def _triangles(model: AspectGraph) -> Array:
    """(T, 3) triples of nodes that are neighbours of each other."""
    count = len(model.directions)
    adjacent = np.zeros((count, count), bool)
    adjacent[model.edges[:, 0], model.edges[:, 1]] = True
    adjacent |= adjacent.T
    found = []
    for a, b in np.sort(model.edges, axis=1):
        for c in np.flatnonzero(adjacent[a] & adjacent[b]):
            if c > b:
                found.append((a, b, c))
    return np.array(sorted(set(found)), np.int32).reshape(-1, 3)


def _in_triangles(middles: FloatArray, model: AspectGraph) -> tuple[Array, Array, FloatArray]:
    """Cells inside a triangle, its corners (N, 3) and the barycentric weights (N, 3)."""
    triangles = _triangles(model)
    inside: list[Array] = []
    corners: list[Array] = []
    parts: list[FloatArray] = []
    taken = np.zeros(len(middles), bool)
    for triangle in triangles:
        base = model.directions[triangle].T
        if abs(np.linalg.det(base)) < 1e-9:
            continue
        weights = np.linalg.solve(base, middles.T).T
        here = np.flatnonzero((weights >= -1e-9).all(axis=1) & ~taken)
        if len(here) == 0:
            continue
        taken[here] = True
        share = np.maximum(weights[here], 0.0)
        inside.append(here)
        corners.append(np.repeat(triangle[None], len(here), axis=0))
        parts.append(share / share.sum(axis=1, keepdims=True))
    if not inside:
        return np.empty(0, int), np.empty((0, 3), np.int32), np.empty((0, 3))
    return np.concatenate(inside), np.concatenate(corners), np.concatenate(parts)


def _along_edges(middles: FloatArray, model: AspectGraph) -> tuple[Array, Array, FloatArray]:
    """For every cell its nearest edge: all cells, the edge's nodes (CELLS, 2) and weights (CELLS, 2)."""
    a, b = model.directions[model.edges].transpose(1, 0, 2)
    best = np.full(len(middles), -np.inf)
    pairs = np.zeros((len(middles), 2), np.int32)
    shares = np.zeros((len(middles), 2))
    for edge, start, end in zip(model.edges, a, b, strict=True):
        length = float(np.arccos(np.clip(start @ end, -1.0, 1.0)))
        across = np.cross(start, end)
        flat = middles - np.outer(middles @ across, across) / (across @ across)
        along = np.arctan2(flat @ np.cross(across / np.linalg.norm(across), start), flat @ start)
        share = np.clip(along / length, 0.0, 1.0)
        point = np.sin((1.0 - share) * length)[:, None] * start + np.sin(share * length)[:, None] * end
        closeness = (middles * point).sum(axis=1) / np.sin(length)
        here = closeness > best
        best[here] = closeness[here]
        pairs[here] = edge
        shares[here] = np.stack([1.0 - share[here], share[here]], axis=1)
    return np.arange(len(middles)), pairs, shares
