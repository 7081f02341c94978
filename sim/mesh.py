"""Checks a Wavefront OBJ before pybullet loads it: pybullet renders white, draws nothing or crashes without a word.

What is refused here was tried on pybullet 3.2.7: missing or unreadable textures, progressive JPEG, PNG with other than
8 bits per channel, absolute texture paths, face indices out of range.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

import cv2
import numpy as np

from viewsep.errors import BadMesh
from viewsep.messages import Array, FloatArray

SMALLEST_M = 0.001
LARGEST_M = 10.0

Line = tuple[int, str]
"""Line number from 1, and the line without its first word."""
Lines = dict[str, list[Line]]
"""A file's lines by their first word, in the file's order."""


@dataclass(frozen=True, slots=True)
class Mesh:
    """A mesh that will render as it should look.

    `path` is the OBJ, `material` its MTL and `texture` the picture that its one material maps. `centre_m` is the
    middle of the axis-aligned bounding box and `radius_m` the largest distance of a vertex from it, metres in the
    mesh's own frame. `digest` is the sha256 (hex) over the bytes of OBJ, MTL and texture, wherever they lie.
    """

    path: Path
    material: Path
    texture: Path
    centre_m: tuple[float, float, float]
    radius_m: float
    vertices: int
    faces: int
    digest: str


def find_mesh(source: Path) -> Path:
    """The mesh file meant by `source`: the file itself, or the only .obj in a folder.

    Raises BadMesh where nothing exists, or where the folder holds no .obj or several.
    """
    if source.is_file():
        return source
    if not source.is_dir():
        raise BadMesh(f"{source}: does not exist; name an .obj file or a folder that holds one")
    found = sorted(path for path in source.iterdir() if path.suffix.lower() == ".obj")
    if not found:
        raise BadMesh(f"{source}: the folder holds no .obj file; name the mesh file, or list photos in views.csv")
    if len(found) > 1:
        raise BadMesh(f"{source}: the folder holds several meshes ({_names(p.name for p in found)}); name one file")
    return found[0]


def check_mesh(path: Path) -> Mesh:
    """Read the OBJ at `path` with its material and texture and make sure pybullet will show them.

    Raises BadMesh, naming file, line and remedy, for anything that would render white, wrong or not at all.
    """
    if path.suffix.lower() != ".obj":
        raise BadMesh(f"{path}: not a Wavefront OBJ by its name; export the mesh as .obj with .mtl and texture")
    data = _read(path, "mesh")
    lines = _lines(path, data)
    points = _numbers(path, lines, "v", 3)
    if not len(points):
        raise BadMesh(f"{path}: has no vertices (no 'v' lines); export the mesh again as Wavefront OBJ")
    sizes = (len(points), len(_numbers(path, lines, "vt", 2)), len(_numbers(path, lines, "vn", 3)))
    _check_faces(path, lines.get("f", []), sizes)
    lowest, highest = points.min(axis=0), points.max(axis=0)
    _check_size(path, highest - lowest)
    material_path, material = _material(path, lines)
    material_data = _read(material_path, "material file")
    texture = _texture(path, material_path, _lines(material_path, material_data), material)
    texture_data = _read(texture, "texture")
    _check_picture(texture, texture_data)
    centre = (lowest + highest) / 2
    return Mesh(
        path=path,
        material=material_path,
        texture=texture,
        centre_m=(float(centre[0]), float(centre[1]), float(centre[2])),
        radius_m=float(np.linalg.norm(points - centre, axis=1).max()),
        vertices=len(points),
        faces=len(lines["f"]),
        digest=hashlib.sha256(data + material_data + texture_data).hexdigest(),
    )


def _read(path: Path, what: str) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        reason = error.strerror or str(error)
        raise BadMesh(f"{path}: the {what} cannot be read ({reason}); check the path and its permissions") from error


def _lines(path: Path, data: bytes) -> Lines:
    if b"\0" in data:
        raise BadMesh(f"{path}: is not a text file; export the mesh again as Wavefront OBJ with an MTL")
    lines: Lines = {}
    text = data.decode("utf-8", errors="replace").replace("\t", " ")
    for number, line in enumerate(text.splitlines(), start=1):
        word, _, rest = line.strip().partition(" ")
        lines.setdefault(word, []).append((number, rest))
    return lines


def _names(names: Iterable[str]) -> str:
    listed = list(names)
    return ", ".join(listed[:5]) + (f" and {len(listed) - 5} more" if len(listed) > 5 else "")


def _refuse_first(path: Path, lines: list[Line], fault: Callable[[str], str]) -> None:
    """Raise BadMesh about the first of `lines` that `fault` has something to say about."""
    for number, rest in lines:
        if text := fault(rest):
            raise BadMesh(f"{path}: line {number}: {text}; repair that line or export the mesh again")


def _numbers(path: Path, lines: Lines, word: str, width: int) -> FloatArray:
    """The first `width` numbers of every `word` line, (N, width). Only normals may be NaN: small scanned faces are."""
    rows = lines.get(word, [])
    values = np.empty((0, width))
    if rows and all(rest for _, rest in rows):
        with suppress(ValueError):
            values = np.loadtxt([rest for _, rest in rows], usecols=range(width), comments=None, ndmin=2)
    if len(values) != len(rows) or (word != "vn" and not np.isfinite(values).all()):
        _refuse_first(path, rows, lambda rest: _number_fault(rest, word, width))
        raise BadMesh(f"{path}: the '{word}' lines are not all plain numbers; export the mesh again")
    return values


def _number_fault(rest: str, word: str, width: int) -> str:
    numbers = rest.split()[:width]
    if len(numbers) < width:
        return f"'{word} {rest}' has {len(numbers)} of {width} numbers"
    for text in numbers:
        try:
            number = float(text)
        except ValueError:
            return f"'{text}' in '{word} {rest}' is not a number"
        if word != "vn" and not np.isfinite(number):
            return f"'{text}' in '{word} {rest}' is not a finite number"
    return ""


def _check_faces(path: Path, lines: list[Line], sizes: tuple[int, int, int]) -> None:
    if not lines:
        raise BadMesh(f"{path}: has no faces (no 'f' lines), a point cloud cannot be rendered; export a surface mesh")
    if not _plainly_sound(lines, sizes):
        _refuse_first(path, lines, lambda rest: _face_fault(rest, sizes))


def _plainly_sound(lines: list[Line], sizes: tuple[int, int, int]) -> bool:
    """Whether all faces are complete and written in one style: true of nearly every mesh, and quick to tell."""
    faces = [rest.split() for _, rest in lines]
    try:
        corners = np.loadtxt(list(chain.from_iterable(faces)), np.int64, comments=None, delimiter="/", ndmin=2)
    except ValueError:
        return False
    styled = corners.shape[1] in (2, 3) and min(map(len, faces)) >= 3
    return styled and all(_in_range(used, size) for used, size in zip(corners.T, sizes, strict=False))


def _in_range(indices: Array, size: int) -> bool:
    """Whether all indices count from 1, or back from -1, within `size` entries."""
    return bool(((indices != 0) & (indices >= -size) & (indices <= size)).all())


def _face_fault(rest: str, sizes: tuple[int, int, int]) -> str:
    corners = rest.split()
    if len(corners) < 3:
        return f"the face 'f {rest}' has {len(corners)} corners, it needs 3 or more"
    for corner in corners:
        parts = corner.split("/")
        if len(parts) < 2 or not parts[1]:
            return f"the face corner '{corner}' has no texture coordinate (vertex/texture[/normal])"
        if len(parts) > 3:
            return f"the face corner '{corner}' is not vertex/texture[/normal]"
        for text, size, what in zip(parts, sizes, ("vertex", "texture coordinate", "normal"), strict=False):
            if what == "normal" and not text:
                continue
            try:
                index = int(text)
            except ValueError:
                return f"the face index '{text}' in '{corner}' is not a whole number"
            if not _in_range(np.array(index), size):
                return f"the face corner '{corner}' asks for {what} {index}, but there are {size}"
    return ""


def _check_size(path: Path, extents: FloatArray) -> None:
    largest = float(extents.max())
    if not SMALLEST_M <= largest <= LARGEST_M:
        seen = " x ".join(f"{extent:.4g}" for extent in extents)
        raise BadMesh(
            f"{path}: is {seen} m large, but sizes in metres between {SMALLEST_M:g} and {LARGEST_M:g} are expected; "
            "scale the mesh to metres (from millimetres: times 0.001)"
        )


def _material(path: Path, lines: Lines) -> tuple[Path, str]:
    """The MTL file and the name of the one material the mesh uses, as pybullet reads them."""
    if not lines.get("mtllib"):
        raise BadMesh(f"{path}: has no 'mtllib' line, so it has no material; export it with its .mtl and texture")
    # pybullet takes the last such line, and of a name only what comes before a blank
    named = lines["mtllib"][-1][1]
    library = Path(f"{path.parent}/{named.split()[0] if named else ''}")
    if not library.is_file():
        raise BadMesh(
            f"{path}: 'mtllib {named}' names a material file that is missing ({library}); "
            "put it beside the OBJ under a name without blanks"
        )
    used = list(dict.fromkeys(rest.split()[0] for _, rest in lines.get("usemtl", []) if rest))
    if not used:
        raise BadMesh(f"{path}: has no 'usemtl' line, so its faces have no material; add 'usemtl NAME' before them")
    if len(used) > 1:
        raise BadMesh(
            f"{path}: uses {len(used)} materials ({_names(used)}), but the last one's texture would cover everything; "
            "bake them into one texture"
        )
    return library, used[0]


def _texture(path: Path, library: Path, lines: Lines, material: str) -> Path:
    """The picture that `material` maps, by the MTL's `lines`. Its path counts from the OBJ's folder, as in pybullet."""
    begins = {rest.split()[0]: number for number, rest in lines.get("newmtl", []) if rest}
    if material not in begins:
        known = _names(begins) or "none"
        raise BadMesh(f"{library}: has no material '{material}' that {path.name} uses (it has: {known}); rename one")
    ends = min((number for number in begins.values() if number > begins[material]), default=float("inf"))
    maps = [rest for number, rest in lines.get("map_Kd", []) if begins[material] < number < ends and rest]
    if not maps:
        raise BadMesh(
            f"{library}: material '{material}' has no 'map_Kd' texture; add 'map_Kd PICTURE' with a PNG or JPEG"
        )
    texture = Path(f"{path.parent}/{maps[-1]}")
    if not texture.is_file():
        raise BadMesh(
            f"{library}: 'map_Kd {maps[-1]}' names a texture that is missing ({texture}); "
            "put the picture in the OBJ's folder and give its plain name after one blank, without options or quotes"
        )
    return texture


def _check_picture(path: Path, data: bytes) -> None:
    remedy = "save it as an 8-bit RGB PNG and name that in the MTL"
    if kind := _unsuitable(data):
        raise BadMesh(f"{path}: the texture is {kind}, which renders white; {remedy}")
    picture = None
    with suppress(cv2.error):  # raised for absurd dimensions
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        raise BadMesh(f"{path}: the texture is damaged and does not decode; {remedy}")


def _unsuitable(data: bytes) -> str:
    """What `data` is by its content if pybullet cannot show it, else empty."""
    if data.startswith(b"\x89PNG\r\n\x1a\n"):
        depth = data[24] if len(data) > 24 else 8
        return "" if depth == 8 else f"a PNG with {depth} instead of 8 bits per channel"
    if data.startswith(b"\xff\xd8\xff"):
        return _unsuitable_jpeg(data)
    if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
        return "WebP"
    return "neither PNG nor JPEG by its content"


def _unsuitable_jpeg(data: bytes) -> str:
    at = 2
    while at + 10 < len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            if marker > 0xC1:
                return "a progressive (or otherwise unusual) JPEG"
            return "" if data[at + 9] in (1, 3) else "a JPEG that is neither RGB nor grey"
        at += 1 if marker == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return ""
