"""Seeded look-alike product boxes, so that demos and tests need no outside data.

A product is a printed carton: six faces in one palette, each with a layout of its own. Its twin differs by one face,
by one sticker, or (the control) not at all.
"""

from __future__ import annotations

import colorsys
import os
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from viewsep.errors import BadInput
from viewsep.messages import Array, FloatArray

Colour = tuple[int, ...]
"""Red, green, blue, 0 to 255."""
Draw = Callable[[Array, "_Look", np.random.Generator], None]  # prints on a canvas (H, W, 3) uint8 RGB

TILE_PX = 256  # one face in the texture
GRID = 8  # quads per edge: the renderer interpolates texture coordinates without perspective
LARGEST_SEED = 10**9 - 1

_BRANDS = ("VELMO", "TASKA", "ORBEL", "PIRULA", "NUVO", "KESTRA", "LUMA", "BRIXO", "SOLENE", "ZEFFA", "MONDRY", "HALVA")
_KINDS = ("crisp", "classic", "fruity", "crunchy", "golden", "organic", "family", "light", "deluxe")
_GOODS = ("cereal", "biscuits", "tea", "pasta", "cocoa", "muesli", "rice", "crackers", "cookies", "oats")
_FONTS = (cv2.FONT_HERSHEY_DUPLEX, cv2.FONT_HERSHEY_TRIPLEX, cv2.FONT_HERSHEY_COMPLEX, cv2.FONT_HERSHEY_SIMPLEX)
_WORD = re.compile(r"generated:([0-9]{1,9})(?::twin=(face|sticker|none))?(?::sticker=([0-9]{1,3}(?:\.[0-9]{1,6})?))?")


@dataclass(frozen=True, slots=True)
class ProductSpec:
    """Which product to print: `seed` fixes the box, `twin` what differs from it.

    `twin` is None (the product itself), "face" (one face but the front is printed anew), "sticker" (one sticker that
    takes the share `sticker` of an upright face's area) or "none" (a copy). Raises BadInput for other values.
    """

    seed: int
    twin: str | None = None
    sticker: float = 0.06

    def __post_init__(self) -> None:
        if not 0 <= self.seed <= LARGEST_SEED:
            raise BadInput(f"product seed {self.seed} is out of range; take a whole number from 0 to {LARGEST_SEED}")
        if self.twin not in (None, "face", "sticker", "none"):
            raise BadInput(f"product twin '{self.twin}' is unknown; take face, sticker or none")
        if not 0.005 <= self.sticker <= 0.5:
            raise BadInput(f"sticker={self.sticker:g} is no share of a face from 0.005 to 0.5; try sticker=0.06")

    @property
    def name(self) -> str:
        """For folders and libraries: `product_7`, `product_7_twin_face`."""
        return f"product_{self.seed}" + (f"_twin_{self.twin}" if self.twin else "")


def parse_product(text: str) -> ProductSpec:
    """The product meant by `generated:SEED[:twin=face|sticker|none][:sticker=SHARE]`.

    Raises BadInput for anything else, and for a sticker's share where there is no sticker.
    """
    found = _WORD.fullmatch(text)
    if not found:
        raise BadInput(
            f"'{text}' is not a generated product (generated:SEED[:twin=face|sticker|none][:sticker=SHARE]); "
            "write for example generated:7:twin=sticker:sticker=0.06"
        )
    seed, twin, share = found.groups()
    if share and twin != "sticker":
        raise BadInput(
            f"'{text}' sizes a sticker it does not have; write generated:{seed}:twin=sticker:sticker={share}"
        )
    return ProductSpec(int(seed), twin, float(share or 0.06))


def write_product(spec: ProductSpec, folder: Path) -> Path:
    """Write `textured.obj`, `textured.mtl` and `texture_map.png` into `folder` (made if need be); the OBJ's path.

    The same spec gives the same bytes. The box stands on z = 0, its front looks along -y. Raises BadInput where the
    folder cannot be written.
    """
    size = _box_size(spec.seed)
    _, png = cv2.imencode(".png", cv2.cvtColor(_atlas(spec, size), cv2.COLOR_RGB2BGR))
    material = "newmtl print\nKa 1 1 1\nKd 1 1 1\nKs 0 0 0\nmap_Kd texture_map.png\n"
    # the OBJ comes last: where it stands, the others do
    files = {"texture_map.png": png.tobytes(), "textured.mtl": material.encode(), "textured.obj": _obj(size).encode()}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, data in files.items():
            unfinished = folder / f".{name}.{os.getpid()}"
            unfinished.write_bytes(data)
            unfinished.replace(folder / name)
    except OSError as error:
        reason = error.strerror or str(error)
        raise BadInput(f"{folder}: cannot write {spec.name} ({reason}); name a folder you may write to") from error
    return folder / "textured.obj"


@dataclass(frozen=True, slots=True)
class _Face:
    """One side of the box: outward normal, what is up for its print, and what is printed."""

    normal: tuple[int, int, int]
    up: tuple[int, int, int]
    draw: Draw

    @property
    def right(self) -> FloatArray:
        """The print's right-hand direction, seen from outside."""
        return np.cross(self.up, self.normal).astype(np.float64)


def _box_size(seed: int) -> FloatArray:
    """Edges (3,) in metres: width (x), depth (y), height (z)."""
    rng = np.random.default_rng([seed, 100])
    depth = rng.uniform(0.06, 0.09)
    return np.array([depth * rng.uniform(1.5, 2.2), depth, rng.uniform(0.12, 0.22)])


def _tile(index: int) -> tuple[slice, slice]:
    """Where face `index` stands in the texture: rows, columns."""
    row, column = divmod(index, 3)
    return slice(row * TILE_PX, (row + 1) * TILE_PX), slice(column * TILE_PX, (column + 1) * TILE_PX)


def _obj(size: FloatArray) -> str:
    """The OBJ text of a box of `size` (3,) metres: each face a grid of its own, so that prints end at the edges."""
    steps = np.linspace(0.0, 1.0, GRID + 1)
    across, upward = (values.ravel() for values in np.meshgrid(steps, steps))
    lines = ["mtllib textured.mtl", "usemtl print"]
    for index, face in enumerate(_FACES):
        offsets = np.outer(2 * across - 1, face.right) + np.outer(2 * upward - 1, face.up) + np.array(face.normal)
        lines += [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in offsets * size / 2 + [0, 0, size[2] / 2]]
        rows, columns = _tile(index)
        # from the middle of the first pixel to that of the last: no colour of the next tile
        u = (columns.start + 0.5 + across * (TILE_PX - 1)) / (3 * TILE_PX)
        v = 1 - (rows.start + 0.5 + (1 - upward) * (TILE_PX - 1)) / (2 * TILE_PX)
        lines += [f"vt {a:.6f} {b:.6f}" for a, b in zip(u, v, strict=True)]
        lines.append("vn {} {} {}".format(*face.normal))
    row = GRID + 1
    for index in range(len(_FACES)):
        for quad in range(GRID * GRID):
            corner = index * row * row + quad // GRID * row + quad % GRID + 1
            for triangle in ((corner, corner + 1, corner + row + 1), (corner, corner + row + 1, corner + row)):
                lines.append("f " + " ".join(f"{point}/{point}/{index + 1}" for point in triangle))
    return "\n".join(lines) + "\n"


@dataclass(frozen=True, slots=True)
class _Look:
    """What the faces of one product share."""

    base: Colour
    accent: Colour
    fruit: Colour
    paper: Colour
    ink: Colour
    brand: str
    kind: str
    goods: str
    font: int


def _look(seed: int) -> _Look:
    rng = np.random.default_rng([seed, 101])
    hue = rng.uniform()

    def colour(turn: float, saturation: float, value: float) -> Colour:
        return tuple(round(255 * channel) for channel in colorsys.hsv_to_rgb((hue + turn) % 1.0, saturation, value))

    return _Look(
        base=colour(0.0, rng.uniform(0.75, 0.95), rng.uniform(0.6, 0.9)),
        accent=colour(rng.uniform(0.35, 0.65), rng.uniform(0.65, 0.9), rng.uniform(0.75, 0.95)),
        fruit=colour(rng.uniform(0.12, 0.3), rng.uniform(0.7, 0.95), rng.uniform(0.7, 0.95)),
        paper=colour(rng.uniform(-0.1, 0.1), rng.uniform(0.03, 0.15), 0.96),
        ink=colour(rng.uniform(-0.1, 0.1), 0.6, rng.uniform(0.12, 0.28)),
        brand=str(rng.choice(_BRANDS)),
        kind=str(rng.choice(_KINDS)),
        goods=str(rng.choice(_GOODS)),
        font=int(rng.choice(_FONTS)),
    )


def _atlas(spec: ProductSpec, size: FloatArray) -> Array:
    """The texture (512, 768, 3) uint8 RGB of a box of `size` (3,) metres."""
    look = _look(spec.seed)
    atlas = np.zeros((2 * TILE_PX, 3 * TILE_PX, 3), np.uint8)
    for index, face in enumerate(_FACES):
        atlas[_tile(index)] = _printed(face, face.draw, look, size, np.random.default_rng([spec.seed, index]))
    rng = np.random.default_rng([spec.seed, 102])
    if spec.twin == "face":
        index = int(rng.integers(1, len(_FACES)))
        ground = _furthest((look.base, look.accent, look.paper, look.fruit), atlas[_tile(index)])
        atlas[_tile(index)] = _printed(_FACES[index], partial(_promotion, ground), look, size, rng)
    elif spec.twin == "sticker":
        index = int(rng.integers(0, 4))
        width, height = (float(np.abs(edge) @ size) for edge in (_FACES[index].right, _FACES[index].up))
        _stick(atlas[_tile(index)], spec.sticker, width / height, rng)
    return atlas


def _printed(face: _Face, draw: Draw, look: _Look, size: FloatArray, rng: np.random.Generator) -> Array:
    """A face's print (TILE_PX, TILE_PX, 3), drawn in the face's true proportions and only then made square."""
    edges = np.array([np.abs(face.up) @ size, np.abs(face.right) @ size])
    height, width = (round(float(edge)) for edge in edges / edges.max() * 2 * TILE_PX)
    canvas = np.zeros((height, width, 3), np.uint8)
    draw(canvas, look, rng)
    return cv2.resize(canvas, (TILE_PX, TILE_PX), interpolation=cv2.INTER_AREA)


def _furthest(colours: tuple[Colour, ...], tile: Array) -> Colour:
    """Which of `colours` is least like `tile`'s pixels."""
    return max(colours, key=lambda colour: float(np.linalg.norm(tile.mean(axis=(0, 1)) - colour)))


def _part(canvas: Array, left: float, top: float, right: float, bottom: float) -> Array:
    """The part of `canvas` between shares of its width and height, as a view to draw on."""
    height, width = canvas.shape[:2]
    return canvas[round(top * height) : round(bottom * height), round(left * width) : round(right * width)]


def _lettering(box: Array, text: str, colour: Colour, font: int, outline: Colour | None = None) -> None:
    """`text` as large as `box` allows, in its middle; along the longer edge where that is much longer."""
    height, width = box.shape[:2]
    if height > 1.6 * width:
        turned = np.ascontiguousarray(np.rot90(box, -1))
        _lettering(turned, text, colour, font, outline)
        box[:] = np.rot90(turned)
        return
    (wide, tall), below = cv2.getTextSize(text, font, 1.0, 2)
    scale = min(0.94 * width / wide, 0.85 * height / (tall + below))
    thickness = max(1, round(2.2 * scale))
    origin = (round((width - wide * scale) / 2), round((height + (tall - 0.6 * below) * scale) / 2))
    if outline:
        cv2.putText(box, text, origin, font, scale, outline, 3 * thickness, cv2.LINE_AA)
    cv2.putText(box, text, origin, font, scale, colour, thickness, cv2.LINE_AA)


def _blobs(box: Array, colours: tuple[Colour, ...], count: int, rng: np.random.Generator) -> None:
    """`count` fruit-like things: a body with shadow and highlight."""
    height, width = box.shape[:2]
    for _ in range(count):
        radius = rng.uniform(0.12, 0.2) * min(height, width) + 2
        x, y = rng.uniform(0.2, 0.8) * width, rng.uniform(0.25, 0.75) * height
        colour = np.array(colours[rng.integers(len(colours))])
        flat, angle = rng.uniform(0.75, 1.0), rng.uniform(0, 180)
        for shrink, shift, shade in ((1.0, 0.0, 0.6), (0.9, 0.08, 1.0), (0.25, 0.4, 1.5)):
            body = ((x - shift * radius, y - shift * radius), (2 * shrink * radius, 2 * shrink * radius * flat), angle)
            cv2.ellipse(box, body, np.minimum(colour * shade, 255).tolist(), -1, cv2.LINE_AA)


def _barcode(box: Array, rng: np.random.Generator) -> None:
    box[:] = 255
    height, width = box.shape[:2]
    at = round(0.08 * width)
    while at < 0.9 * width:
        bar = int(rng.integers(2, 6))
        box[round(0.08 * height) : round(0.85 * height), at : at + bar] = 0
        at += bar + int(rng.integers(2, 6))


def _text_block(box: Array, colour: Colour, rows: int, rng: np.random.Generator) -> None:
    """Lines of words too small to read: what counts is their grain."""
    height, width = box.shape[:2]
    for row in range(rows):
        y, at = round((row + 0.5) * height / rows), 0
        end = width * (rng.uniform(0.3, 0.7) if row % 5 == 4 else rng.uniform(0.9, 1.0))
        while at < end:
            word = int(rng.integers(8, 40))
            cv2.line(box, (at, y), (min(at + word, round(end)), y), colour, max(2, height // (3 * rows)))
            at += word + 9


def _directions(count: int) -> FloatArray:
    """`count` unit vectors (N, 2) around, the first one upwards in the picture."""
    turns = np.arange(count) * 2 * np.pi / count - np.pi / 2
    return np.column_stack([np.cos(turns), np.sin(turns)])


def _logo(box: Array, colour: Colour, inner: Colour, corners: int) -> None:
    """A disc with a polygon in it."""
    height, width = box.shape[:2]
    radius = 0.46 * min(height, width)
    polygon = np.array([width / 2, height / 2]) + 0.75 * radius * _directions(corners)
    cv2.circle(box, (width // 2, height // 2), round(radius), colour, -1, cv2.LINE_AA)
    cv2.fillPoly(box, [np.round(polygon).astype(np.int32)], inner, cv2.LINE_AA)


def _front(canvas: Array, look: _Look, rng: np.random.Generator) -> None:
    canvas[:] = look.base
    height, width = canvas.shape[:2]
    plate = (1.5 * width, rng.uniform(0.5, 1.0) * height)
    cv2.ellipse(canvas, ((width / 2, float(height)), plate, 0.0), look.paper, -1)
    _blobs(_part(canvas, 0.05, 0.52, 0.95, 0.95), (look.fruit, look.accent), int(rng.integers(6, 11)), rng)
    _logo(_part(canvas, 0.05, 0.03, 0.3, 0.2), look.accent, look.paper, int(rng.integers(3, 8)))
    _lettering(_part(canvas, 0.35, 0.05, 0.95, 0.17), look.kind, look.paper, look.font)
    _lettering(_part(canvas, 0.04, 0.2, 0.96, 0.42), look.brand, look.paper, look.font, look.ink)
    _part(canvas, 0.0, 0.43, 1.0, 0.52)[:] = look.accent
    _lettering(_part(canvas, 0.1, 0.43, 0.9, 0.52), look.goods, look.ink, look.font)
    _lettering(_part(canvas, 0.65, 0.91, 0.97, 0.98), f"{25 * int(rng.integers(8, 30))} g", look.ink, look.font)


def _right(canvas: Array, look: _Look, rng: np.random.Generator) -> None:
    canvas[:] = look.base
    height, width = canvas.shape[:2]
    pitch = round(rng.uniform(0.12, 0.2) * height)
    for y in range(-8 * pitch, 10 * pitch, pitch):
        cv2.line(canvas, (0, y), (width, y + width), look.accent, round(0.35 * pitch))
    panel = _part(canvas, 0.2, 0.08, 0.8, 0.72)
    panel[:] = look.paper
    _lettering(panel, look.brand, look.ink, look.font)
    _logo(_part(canvas, 0.2, 0.76, 0.8, 0.96), look.fruit, look.paper, int(rng.integers(3, 8)))


def _back(canvas: Array, look: _Look, rng: np.random.Generator) -> None:
    canvas[:] = look.paper
    _part(canvas, 0.0, 0.0, 1.0, 0.18)[:] = look.base
    _lettering(_part(canvas, 0.05, 0.02, 0.95, 0.16), f"{look.brand} {look.goods}", look.paper, look.font)
    _text_block(_part(canvas, 0.06, 0.22, 0.94, 0.48), look.ink, int(rng.integers(7, 11)), rng)
    picture = _part(canvas, 0.06, 0.52, 0.5, 0.94)
    picture[:] = look.accent
    _blobs(picture, (look.fruit, look.base), 5, rng)
    _text_block(_part(canvas, 0.55, 0.52, 0.94, 0.7), look.ink, 5, rng)
    _barcode(_part(canvas, 0.55, 0.74, 0.94, 0.94), rng)


def _left(canvas: Array, look: _Look, rng: np.random.Generator) -> None:
    canvas[:] = look.fruit
    _lettering(_part(canvas, 0.08, 0.02, 0.92, 0.12), look.kind, look.ink, look.font)
    table = _part(canvas, 0.08, 0.14, 0.92, 0.7)
    table[:] = look.paper
    rows = int(rng.integers(7, 11))
    _part(table, 0.0, 0.0, 1.0, 1 / rows)[:] = look.ink
    for row in range(1, rows):
        top, bottom = (row + 0.35) / rows, (row + 0.6) / rows
        _part(table, 0.06, top, rng.uniform(0.3, 0.6), bottom)[:] = look.ink
        _part(table, rng.uniform(0.7, 0.85), top, 0.94, bottom)[:] = look.ink
    _text_block(_part(canvas, 0.08, 0.75, 0.92, 0.96), look.ink, 6, rng)


def _top(canvas: Array, look: _Look, rng: np.random.Generator) -> None:
    canvas[:] = look.accent
    band = rng.uniform(0.14, 0.22)
    _part(canvas, 0.0, 0.0, 1.0, band)[:] = look.base
    _part(canvas, 0.0, 1 - band, 1.0, 1.0)[:] = look.ink
    _lettering(_part(canvas, 0.05, band, 0.95, 1 - band), look.brand, look.paper, look.font, look.ink)


def _bottom(canvas: Array, look: _Look, rng: np.random.Generator) -> None:
    canvas[:] = look.paper
    _part(canvas, 0.0, 0.0, 0.45, 1.0)[:] = look.ink
    _barcode(_part(canvas, 0.06, 0.15, 0.4, 0.85), rng)
    _lettering(_part(canvas, 0.5, 0.1, 0.97, 0.5), f"L{int(rng.integers(1000, 9999))}", look.ink, look.font)
    _text_block(_part(canvas, 0.52, 0.55, 0.94, 0.9), look.base, 4, rng)


def _promotion(ground: Colour, canvas: Array, look: _Look, rng: np.random.Generator) -> None:
    """What a twin's changed face shows instead: another ground, a burst and an offer."""
    canvas[:] = ground
    others = tuple(colour for colour in (look.base, look.accent, look.fruit, look.paper) if colour != ground)
    reach = np.where(np.arange(32) % 2, rng.uniform(0.3, 0.36), 0.48)
    burst = (np.array([0.5, 0.45]) + reach[:, None] * _directions(32)) * canvas.shape[1::-1]
    _blobs(canvas, others, int(rng.integers(12, 18)), rng)
    cv2.fillPoly(canvas, [np.round(burst).astype(np.int32)], others[0], cv2.LINE_AA)
    offer = f"+{5 * int(rng.integers(2, 10))}%"
    _lettering(_part(canvas, 0.2, 0.25, 0.8, 0.65), offer, look.paper, look.font, look.ink)
    _lettering(_part(canvas, 0.05, 0.86, 0.95, 0.98), f"win with {look.brand}", look.ink, look.font, look.paper)


def _stick(tile: Array, share: float, aspect: float, rng: np.random.Generator) -> None:
    """Put a square sticker that covers `share` of `tile` on it; `aspect` is the face's width over its height."""
    across = round(float(np.clip(np.sqrt(share / aspect), share / 0.96, 0.96)) * TILE_PX)
    down = round(TILE_PX**2 * share / across)
    x, y = int(rng.integers(2, TILE_PX - across - 1)), int(rng.integers(2, TILE_PX - down - 1))
    place = tile[y : y + down, x : x + across]
    paper = _furthest(((255, 225, 0), (230, 20, 30), (255, 255, 255), (20, 110, 220)), place)
    ink = (20, 20, 20) if sum(paper) > 380 else (255, 255, 255)
    sticker = np.full((256, 256, 3), paper, np.uint8)
    cv2.rectangle(sticker, (18, 18), (237, 237), ink, 8)
    _lettering(_part(sticker, 0.12, 0.2, 0.88, 0.8), f"-{5 * int(rng.integers(2, 15))}%", ink, cv2.FONT_HERSHEY_DUPLEX)
    place[:] = cv2.resize(sticker, (across, down), interpolation=cv2.INTER_AREA)


# the upright faces come first: stickers go there
_FACES = (
    _Face((0, -1, 0), (0, 0, 1), _front),
    _Face((1, 0, 0), (0, 0, 1), _right),
    _Face((0, 1, 0), (0, 0, 1), _back),
    _Face((-1, 0, 0), (0, 0, 1), _left),
    _Face((0, 0, 1), (0, 1, 0), _top),
    _Face((0, 0, -1), (0, -1, 0), _bottom),
)
