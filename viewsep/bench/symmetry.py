"""How an object can be turned without looking different, found from pictures of it: poses are scored modulo that.

Candidates are turns about the axes of the smallest box around the mesh, about its principal axes and those of its
file: by 45, 60, 90, 120 and 180 degrees, and by every angle. Photos tell of turns about the vertical only. A turn is a
symmetry when pictures before and after it differ little, both in grey levels and beside pictures from random sides.
What counts is the 90th percentile of a picture's differences: in the mean a label would drown in what is plain around
it. The limits were set by eye on scanned products.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial import ConvexHull, QhullError

from viewsep.bench.setup import Setup
from viewsep.geometry import (
    angle_between,
    axis_rotation,
    fibonacci_sphere,
    nearest_points,
    perpendicular,
    random_rotation,
    rotation_angle,
    rotation_showing,
)
from viewsep.learning import CAMERA_DIRECTION
from viewsep.messages import Array, FloatArray
from viewsep.sim.mesh import find_mesh
from viewsep.sim.products import parse_product, write_product
from viewsep.sim.render import CameraOptics, Pictures
from viewsep.sim.source import GENERATED, open_pictures
from viewsep.sim.view_set import is_view_set, read_view_set

SIZE_PX = 64
BLUR_PX = 1.0  # scans are rough, and edges fall between pixels
VIEWS, FIRST_VIEWS = 40, 8  # a turn that fails on the first views is not tried on the others
MOST_GREY, LEAST_GREY = 30.0, 4.0  # levels of 255 that count as no difference: at the most, and in any case
MOST_SHARE = 0.25  # of what pictures from random sides differ by
DISCRETE_DEG = (45.0, 60.0, 90.0, 120.0, 180.0)
ANY_DEG = (130, 70, *range(10, 190, 10))  # stand for any angle; those first at which no regular body repeats
SAME_RAD = np.radians(5.0)  # rotations closer than this are the same
APART_RAD = np.radians(15.0)  # between axes; those of regular bodies are more than 30 degrees apart
FACETS = 400  # of the hull that the smallest box may lie on, the largest ones
LARGEST_GROUP = 60  # rotations of the icosahedron; more are none that leave a body as it is
PHOTO_GAP_RAD = np.radians(3.0)  # from where a photo should have been taken
UP = np.array([0.0, 0.0, 1.0])

Picture = tuple[FloatArray, Array]
"""Blurred picture (H, W, 3) and mask (H, W) bool."""


@dataclass(frozen=True, eq=False, slots=True)
class Turn:
    """A turn by `degrees` (0: by any angle) about the unit vector `axis` (3,) in the object frame."""

    axis: FloatArray
    degrees: float


@dataclass(frozen=True, eq=False)
class Symmetries:
    """The turns that leave an object looking as it was, and with them all that follow from several of them."""

    turns: tuple[Turn, ...]

    @cached_property
    def axes(self) -> list[FloatArray]:
        """The axes (3,) about which any turn is one; with two of them the object is a ball."""
        return [turn.axis for turn in self.turns if turn.degrees == 0.0]

    @cached_property
    def rotations(self) -> FloatArray:
        """(S, 3, 3) the rotations by single angles, the identity first: a group, as far as it stays a small one."""
        generators = [axis_rotation(turn.axis, np.radians(turn.degrees)) for turn in self.turns if turn.degrees]
        group = [np.eye(3)]
        for rotation in group:  # grows meanwhile
            for generator in generators:
                product = rotation @ generator
                if rotation_angle(np.array(group), product).min() > SAME_RAD and len(group) < LARGEST_GROUP:
                    group.append(product)
        return np.array(group)

    def error(self, estimated: FloatArray, true: FloatArray) -> float:
        """Radians from a rotation (3, 3) object -> control to the closest that looks like the true one."""
        if len(self.axes) > 1:
            return 0.0
        alike = true @ self.rotations
        if self.axes:  # what is left of a rotation when any turn about the axis is free
            return float(angle_between(alike @ self.axes[0], estimated @ self.axes[0]).min())
        return float(rotation_angle(alike, estimated).min())

    def follows(self, turn: FloatArray) -> bool:
        """Whether the rotation (3, 3) is one of them."""
        return bool(self.error(turn, np.eye(3)) < SAME_RAD)


def symmetries(source: str, setup: Setup) -> Symmetries:
    """Those of a mesh, a generated product or an object of which there are photos. Raises BadInput, BadMesh."""
    return _symmetries(source, Setup(cache=setup.cache))


@lru_cache(maxsize=1024)
def _symmetries(source: str, setup: Setup) -> Symmetries:
    pictures = open_pictures(source, CameraOptics(SIZE_PX), setup.cache)
    try:
        if is_view_set(Path(source)):
            directions = read_view_set(Path(source)).directions
            return Symmetries(_found([UP], _Looks(pictures, directions, photos=True)))
        return Symmetries(_found(axes_of(_vertices(source)), _Looks(pictures, fibonacci_sphere(VIEWS), photos=False)))
    finally:
        pictures.close()


def _found(axes: Sequence[FloatArray], looks: _Looks) -> tuple[Turn, ...]:
    """The symmetries about the axes, without those that follow from others and axes close to one that has some."""
    turns: tuple[Turn, ...] = ()
    for axis in map(_upright, axes):
        known = [float(axis @ turn.axis) for turn in turns]
        free = Symmetries(turns).follows(axis_rotation(axis, np.radians(ANY_DEG[0])))
        if free or (np.abs(known) > np.cos(APART_RAD)).any():
            continue
        if all(looks.alike(axis_rotation(axis, np.radians(degrees))) for degrees in ANY_DEG):
            turns = (*turns, Turn(axis, 0.0))
            continue
        for degrees in DISCRETE_DEG:
            turn = axis_rotation(axis, np.radians(degrees))
            if not Symmetries(turns).follows(turn) and looks.alike(turn):
                turns = (*turns, Turn(axis, degrees))
    return turns


class _Looks:
    """Pictures of an object from `directions` (N, 3), to be compared with those after a turn."""

    def __init__(self, pictures: Pictures, directions: FloatArray, *, photos: bool) -> None:
        order = np.random.default_rng(0).permutation(len(directions))  # so that the first ones lie all around
        self._directions = directions[order]
        self._photos = photos
        self._pictures = pictures
        self._before = [self._picture(direction, np.eye(3)) for direction in self._directions]
        rng = np.random.default_rng(1)
        apart = [
            _difference(before, self._picture(direction, random_rotation(rng)))
            for before, direction in zip(self._before, self._directions, strict=True)
        ]
        self._limit = max(LEAST_GREY, min(MOST_GREY, MOST_SHARE * float(np.mean(apart))))

    def alike(self, turn: FloatArray) -> bool:
        """Whether the object looks the same after the `turn` (3, 3), from all directions on average."""
        shown = np.arange(len(self._directions))
        if self._photos:
            shown = np.flatnonzero(nearest_points(self._directions, self._directions @ turn)[0] < PHOTO_GAP_RAD)
        if len(shown) < FIRST_VIEWS:
            return False
        differences: list[float] = []
        for part, allowed in ((shown[:FIRST_VIEWS], 1.5 * self._limit), (shown[FIRST_VIEWS:], self._limit)):
            differences += [_difference(self._before[i], self._picture(self._directions[i], turn)) for i in part]
            if np.mean(differences) > allowed:
                return False
        return True

    def _picture(self, direction: FloatArray, turn: FloatArray) -> Picture:
        shown = rotation_showing(direction, CAMERA_DIRECTION) @ turn
        image, mask = self._pictures.render(CAMERA_DIRECTION, shown)
        return np.asarray(cv2.GaussianBlur(image.astype(np.float64), (0, 0), BLUR_PX), np.float64), mask


def _difference(a: Picture, b: Picture) -> float:
    """Grey levels (mean over the channels) that nine in ten pixels of the object differ by at the most."""
    (image_a, mask_a), (image_b, mask_b) = a, b
    on_object = np.abs(image_a - image_b).mean(axis=2)[mask_a | mask_b]
    return float(np.percentile(on_object, 90.0)) if len(on_object) else 0.0


def axes_of(points: FloatArray) -> list[FloatArray]:
    """Axes (3,) that a body with these points (N, 3) may be symmetric about: box, principal axes, those of the file."""
    try:
        hull = ConvexHull(points)
    except QhullError:  # flat
        return list(np.eye(3))
    corners = points[hull.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    largest = np.argsort(-area, kind="stable")[:FACETS]
    box = _smallest_box(points[hull.vertices], hull.equations[largest, :3])
    axes: list[FloatArray] = []
    for axis in (*box, *np.eye(3), *_principal_axes(corners, area)):
        if not any(abs(float(axis @ other)) > np.cos(np.radians(1.0)) for other in axes):
            axes.append(axis)
    return axes


def _smallest_box(points: FloatArray, normals: FloatArray) -> FloatArray:
    """(3, 3) rows: the edges of the smallest box around the points that lies on a facet with one of the normals."""
    smallest, edges = np.inf, np.eye(3)
    for normal in normals:
        side = perpendicular(normal)
        plane = np.stack([side, np.cross(normal, side)], axis=1)
        _, (width, height), turn_deg = cv2.minAreaRect((points @ plane).astype(np.float32))
        volume = width * height * float(np.ptp(points @ normal))
        if volume < smallest:
            edge = plane @ [np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))]
            smallest, edges = volume, np.stack([normal, edge, np.cross(normal, edge)])
    return edges


def _principal_axes(corners: FloatArray, area: FloatArray) -> FloatArray:
    """(3, 3) rows: the principal axes of a surface of triangles (T, 3, 3)."""
    centre = np.average(corners.mean(axis=1), axis=0, weights=area)
    middles = 0.5 * (corners + np.roll(corners, 1, axis=1)) - centre  # of the edges: exact for second moments
    axes: FloatArray = np.linalg.eigh(np.einsum("t,tki,tkj->ij", area, middles, middles))[1].T
    return axes


def _upright(axis: FloatArray) -> FloatArray:
    """The same axis, its largest component positive."""
    return axis if axis[int(np.argmax(np.abs(axis)))] > 0.0 else -axis


def _vertices(source: str) -> FloatArray:
    """(N, 3) the points of a mesh that was found sound."""
    if source.startswith(GENERATED):
        with tempfile.TemporaryDirectory(prefix="viewsep-") as folder:
            return _points(write_product(parse_product(source), Path(folder)))
    return _points(find_mesh(Path(source)))


def _points(path: Path) -> FloatArray:
    with path.open(encoding="utf-8", errors="replace") as file:
        rows = [line.split()[1:4] for line in file if line[:2] in ("v ", "v\t")]
    return np.array(rows, np.float64)
