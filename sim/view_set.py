"""View sets: a folder with photos of one object and `views.csv`, which says from where each of them was taken.

Columns: `image,azimuth_deg,elevation_deg` and optionally `mask` and `use`, file names relative to the folder. Where a
row names no mask, the object is cut out of the plain background. `use` is `view` (the default) or `trial`: a photo
between the views, from which is learned how looks there differ from what the views predict.
"""

from __future__ import annotations

import csv
import hashlib
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path, PurePosixPath

import cv2
import numpy as np
from scipy.spatial import cKDTree

from viewsep.errors import BadInput
from viewsep.geometry import azimuth_elevation, spherical_direction
from viewsep.messages import Array, BoolArray, FloatArray
from viewsep.sim.segmentation import segment

LIST_NAME = "views.csv"
COLUMNS = ("image", "azimuth_deg", "elevation_deg", "mask", "use")
SAME_VIEW_RAD = 1e-3  # 0.06 deg: closer directions are the same view


class Use(StrEnum):
    """What a photo is for: a view of the model, or a trial between the views, which the likelihood is learned from."""

    VIEW = "view"
    TRIAL = "trial"


@dataclass(frozen=True, eq=False, slots=True)
class ViewSet:
    """N photos of one object, in the order they are listed in.

    `directions` (N, 3) unit vectors in the object frame, from `angles_deg` (N, 2) azimuth and elevation; `images` and
    `masks` file names (mask empty: cut out of the background); `trial` (N,) says which photos are trials. `digest` is
    the sha256 (hex) over the list and the contents of all files it names.
    """

    folder: Path
    name: str
    directions: FloatArray
    angles_deg: FloatArray
    images: tuple[str, ...]
    masks: tuple[str, ...]
    trial: BoolArray
    digest: str

    def load(self, index: int) -> tuple[Array, BoolArray]:
        """Photo (H, W, 3) uint8 RGB and mask (H, W) bool of one view. Raises BadInput naming the file."""
        path = self.folder / self.images[index]
        image = cv2.cvtColor(_decoded(path, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
        if not self.masks[index]:
            return image, segment(image, str(path))
        path = self.folder / self.masks[index]
        mask = np.asarray(_decoded(path, cv2.IMREAD_GRAYSCALE) > 127)
        if mask.shape != image.shape[:2]:
            raise BadInput(
                f"{path}: the mask is {mask.shape[1]} x {mask.shape[0]}, but {self.images[index]} is "
                f"{image.shape[1]} x {image.shape[0]} pixels; make the mask from that photo"
            )
        if not mask.any():
            raise BadInput(f"{path}: the mask is empty; paint the object white on black, or leave the cell empty")
        return image, mask

    def picture(self, index: int, size_px: int) -> tuple[Array, BoolArray]:
        """The photo as the rig's camera shows it: square, reduced to `size_px` where it is larger, never enlarged.

        Bars at the sides of a photo that is not square have the colour of its border. Raises BadInput.
        """
        image, mask = self.load(index)
        scale = min(1.0, size_px / max(mask.shape))
        size = (max(1, round(mask.shape[1] * scale)), max(1, round(mask.shape[0] * scale)))
        if size != mask.shape[::-1]:
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
            mask = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA) >= 0.5
        if not mask.any():
            raise BadInput(
                f"{self.folder / self.images[index]}: at {size_px} pixels nothing is left of the object; cut the photo "
                "closer, or raise the key 'camera.size_px'"
            )
        return _squared(image, mask)


def view_list(rows: Iterable[tuple[str, FloatArray, str, Use]]) -> bytes:
    """The list of photos: image, direction (3,), mask (or empty) and use of each."""
    table = io.StringIO(newline="")
    writer = csv.writer(table, lineterminator="\n")
    writer.writerow(COLUMNS)
    for image, direction, mask, use in rows:
        azimuth_deg, elevation_deg = np.degrees(azimuth_elevation(direction)).tolist()
        writer.writerow((image, f"{azimuth_deg:.4f}", f"{elevation_deg:.4f}", mask, use.value))
    return table.getvalue().encode()


def is_view_set(source: Path) -> bool:
    """Whether `source` is a folder with a list of views. Raises BadInput where it holds a mesh too."""
    if not (source / LIST_NAME).is_file():
        return False
    meshes = sorted(path.name for path in source.iterdir() if path.suffix.lower() == ".obj")
    if meshes:
        raise BadInput(
            f"{source}: holds both {LIST_NAME} and {meshes[0]}, so it may mean photos or a mesh; name the mesh file, "
            "or move one of them to another folder"
        )
    return True


def read_view_set(folder: Path) -> ViewSet:
    """Read and check the list; the photos are decoded when they are loaded.

    Raises BadInput naming file, line, value and remedy.
    """
    path = folder / LIST_NAME
    try:
        data = path.read_bytes()
        lines = list(csv.reader(io.StringIO(data.decode("utf-8-sig"), newline=""), strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"cannot read the list of views {path}: {error}") from error
    rows = [(number, [cell.strip() for cell in row]) for number, row in enumerate(lines, start=1) if any(row)]
    if not rows:
        raise BadInput(
            f"{path}: is empty; its first line names the columns {','.join(COLUMNS)} (mask and use may be left out)"
        )
    columns = _columns(path, rows[0][1])
    views = [_view(path, number, columns, row) for number, row in rows[1:]]
    if not views:
        raise BadInput(f"{path}: lists no views; add one line per photo below the names of the columns")
    numbers = [number for number, _ in rows[1:]]
    angles_deg = np.array([view.angles_deg for view in views])
    directions = np.array([spherical_direction(*angles) for angles in np.radians(angles_deg)])
    _no_view_twice(path, numbers, views, directions)
    return ViewSet(
        folder=folder.resolve(),
        name=folder.resolve().name,
        directions=directions,
        angles_deg=angles_deg,
        images=tuple(view.image for view in views),
        masks=tuple(view.mask for view in views),
        trial=np.array([view.use is Use.TRIAL for view in views]),
        digest=_digest(path, data, numbers, views),
    )


@dataclass(frozen=True, slots=True)
class _View:
    """One line of the list."""

    image: str
    angles_deg: tuple[float, float]
    mask: str
    use: Use


def _columns(path: Path, names: Sequence[str]) -> list[str]:
    """The columns' names in the file's order. Raises BadInput for missing, unknown or repeated ones."""
    for name in COLUMNS[:3]:
        if name not in names:
            raise BadInput(
                f"{path}, line 1: column {name!r} is missing; the first line names the columns {','.join(COLUMNS)} "
                "(mask and use may be left out)"
            )
    for name in names:
        if name not in COLUMNS or list(names).count(name) > 1:
            what = "is there twice" if name in COLUMNS else "is not known"
            raise BadInput(f"{path}, line 1: column {name!r} {what}; the columns are {','.join(COLUMNS)}")
    return list(names)


def _view(path: Path, number: int, columns: Sequence[str], row: Sequence[str]) -> _View:
    """One checked line. Raises BadInput."""
    where = f"{path}, line {number}"
    if len(row) != len(columns):
        raise BadInput(f"{where}: has {len(row)} cells for {len(columns)} columns; write {','.join(columns)}")
    cells = dict(zip(columns, row, strict=True))
    if not cells["image"]:
        raise BadInput(f"{where}: names no image; every line is one photo")
    angles = _angle(where, "azimuth_deg", cells["azimuth_deg"]), _angle(where, "elevation_deg", cells["elevation_deg"])
    if not -90.0 <= angles[1] <= 90.0:
        raise BadInput(
            f"{where}: elevation_deg = {cells['elevation_deg']} is outside [-90, 90]; it counts from the turntable's "
            "plane upwards"
        )
    use = cells.get("use", "") or Use.VIEW
    if use not in list(Use):
        raise BadInput(f"{where}: use = {use!r} is none of {', '.join(Use)}; leave it empty for a view")
    return _View(_file(where, path, cells["image"]), angles, _file(where, path, cells.get("mask", "")), Use(use))


def _angle(where: str, column: str, cell: str) -> float:
    try:
        angle = float(cell)
    except ValueError:
        angle = np.nan
    if not np.isfinite(angle):
        raise BadInput(f"{where}: {column} = {cell!r} is not a number; write degrees, e.g. 22.5")
    return angle


def _file(where: str, path: Path, name: str) -> str:
    """`name` if it is empty or a file in the view set's folder. Raises BadInput."""
    if name and (PurePosixPath(name).is_absolute() or ".." in PurePosixPath(name).parts):
        raise BadInput(f"{where}: {name!r} lies outside the folder; put all files beside {LIST_NAME}")
    if name and not (path.parent / name).is_file():
        raise BadInput(f"{where}: there is no file {name!r} in {path.parent}; correct the name or take the line out")
    return name


def _no_view_twice(path: Path, numbers: Sequence[int], views: Sequence[_View], directions: FloatArray) -> None:
    """Raise BadInput for an image or a direction that two lines share."""
    first: dict[str, int] = {}
    for number, view in zip(numbers, views, strict=True):
        if view.image in first:
            raise BadInput(
                f"{path}, line {number}: image {view.image!r} is in line {first[view.image]} already; list it once"
            )
        first[view.image] = number
    pairs = sorted(cKDTree(directions).query_pairs(SAME_VIEW_RAD))
    if pairs:
        a, b = pairs[0]
        azimuth, elevation = views[b].angles_deg
        raise BadInput(
            f"{path}, line {numbers[b]}: azimuth {azimuth:g} deg, elevation {elevation:g} deg is the direction of line "
            f"{numbers[a]} already; keep one photo per direction"
        )


def _digest(path: Path, data: bytes, numbers: Sequence[int], views: Sequence[_View]) -> str:
    """Sha256 over the list and every file it names. Raises BadInput for a file that cannot be read."""
    h = hashlib.sha256(data)
    for number, view in zip(numbers, views, strict=True):
        for name in filter(None, (view.image, view.mask)):
            try:
                h.update(hashlib.sha256((path.parent / name).read_bytes()).digest())
            except OSError as error:
                raise BadInput(f"{path}, line {number}: cannot read {name!r}: {error.strerror}") from error
    return h.hexdigest()


def _decoded(path: Path, mode: int) -> Array:
    """A picture file as OpenCV reads it. Raises BadInput."""
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise BadInput(f"cannot read the photo {path}: {error.strerror}") from error
    image = cv2.imdecode(data, mode) if len(data) else None
    if image is None:
        raise BadInput(f"{path}: is not a picture, or damaged; save it again as JPEG or PNG")
    return np.asarray(image)


def _squared(image: Array, mask: BoolArray) -> tuple[Array, BoolArray]:
    """Picture and mask in the middle of a square with the colour of the picture's border."""
    height, width = mask.shape
    side = max(height, width)
    if height == width:
        return image, mask
    border = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]])
    square = np.full((side, side, 3), np.median(border, axis=0), np.uint8)
    on_object = np.zeros((side, side), bool)
    top, left = (side - height) // 2, (side - width) // 2
    square[top : top + height, left : left + width] = image
    on_object[top : top + height, left : left + width] = mask
    return square, on_object
