"""A picture of what models hold: every view's thumbnail, from the top of the view sphere downwards."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from viewsep.errors import BadInput
from viewsep.files import write_whole
from viewsep.messages import Array, FloatArray
from viewsep.models.aspect_graph import AspectGraph

DPI = 100
SHOWN = 100  # thumbnails per model, the paper's number of views
RING_RAD = float(np.radians(18.0))  # about the height of a row of equidistant views
COLUMNS, TILE_PX, GAP_PX = 10, 56, 4
TITLE_PX, MARGIN_PX = 56, 24
BESIDE = 3  # models side by side; of many as many as there are rows


def contact_sheet(models: Sequence[AspectGraph], path: Path) -> None:
    """Write a PNG with each model's thumbnails, ordered by rings of equal height and by azimuth within a ring.

    Of models with more than 100 views an even selection is shown. Raises BadInput when there is no model, or `path`
    cannot be written.
    """
    if not models:
        raise BadInput("no models to show: name at least one")
    sheets = [_sheet(model) for model in models]
    columns = min(len(models), max(BESIDE, int(np.ceil(np.sqrt(len(models))))))
    rows = -(-len(models) // columns)
    width = sheets[0].shape[1] + MARGIN_PX
    heights = [
        max(len(sheet) for sheet in sheets[row * columns : (row + 1) * columns]) + TITLE_PX + MARGIN_PX
        for row in range(rows)
    ]
    total_width, total_height = columns * width + MARGIN_PX, sum(heights)
    figure = Figure(figsize=(total_width / DPI, total_height / DPI), dpi=DPI, facecolor="white")
    for i, (model, sheet) in enumerate(zip(models, sheets, strict=True)):
        row, column = divmod(i, columns)
        left, top = MARGIN_PX + column * width, sum(heights[:row]) + TITLE_PX
        box = (left, total_height - top - len(sheet), sheet.shape[1], len(sheet))
        scale = np.array([total_width, total_height, total_width, total_height])
        x, y, w, h = (np.array(box) / scale).tolist()
        _draw(figure.add_axes((x, y, w, h)), model, sheet)
    write_png(figure, path)


def write_png(figure: Figure, path: Path) -> None:
    """Write the figure under a temporary name and rename it to `path`. Raises BadInput where that is impossible."""
    buffer = BytesIO()
    figure.savefig(buffer, format="rgba")
    width, _ = FigureCanvasAgg(figure).get_width_height()
    picture = cv2.cvtColor(np.frombuffer(buffer.getvalue(), np.uint8).reshape(-1, width, 4), cv2.COLOR_RGBA2BGR)
    data = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 9])[1].tobytes()  # without alpha: smaller
    write_whole(path, data, "picture")


def sheet_order(directions: FloatArray) -> Array:
    """Indices of the view directions (N, 3) in rings from the top downwards, by azimuth within each ring."""
    elevation = np.arcsin(np.clip(directions[:, 2], -1.0, 1.0))
    ring = np.floor((np.pi / 2 - elevation) / RING_RAD)
    azimuth = np.arctan2(directions[:, 1], directions[:, 0]) % (2.0 * np.pi)
    return np.lexsort((azimuth, ring))


def short_name(name: str, most: int = 30) -> str:
    """`name`, without its middle where it is longer than `most`: those of look-alikes often differ at the end."""
    return name if len(name) <= most else f"{name[: most // 2]}…{name[-(most // 2 - 1) :]}"


def _sheet(model: AspectGraph) -> Array:
    """(h, w, 3) uint8: the thumbnails on a grid, white between them."""
    order = sheet_order(model.directions)
    if len(order) > SHOWN:
        order = order[np.linspace(0, len(order) - 1, SHOWN).astype(int)]
    step = TILE_PX + GAP_PX
    rows = -(-len(order) // COLUMNS)
    sheet = np.full((rows * step - GAP_PX, COLUMNS * step - GAP_PX, 3), 255, np.uint8)
    for place, node in enumerate(order):
        y, x = (step * p for p in divmod(place, COLUMNS))
        sheet[y : y + TILE_PX, x : x + TILE_PX] = _tile(model.thumbnails[node])
    return sheet


def _tile(thumbnail: Array) -> Array:
    """The (h, w, 3) thumbnail on a white square, enlarged or reduced to nearest pixels; white where it is empty."""
    tile = np.full((TILE_PX, TILE_PX, 3), 255, np.uint8)
    height, width = thumbnail.shape[:2]
    if height == 0 or width == 0:
        return tile
    scale = TILE_PX / max(height, width)
    h, w = max(1, round(height * scale)), max(1, round(width * scale))
    y, x = (np.arange(n) * size // n for n, size in ((h, height), (w, width)))
    top, left = (TILE_PX - h) // 2, (TILE_PX - w) // 2
    tile[top : top + h, left : left + w] = thumbnail[y[:, None], x]
    return tile


def _draw(axes: Axes, model: AspectGraph, sheet: Array) -> None:
    views = len(model.directions)
    shown = f", {SHOWN} shown" if views > SHOWN else ""
    axes.imshow(sheet, interpolation="nearest")
    axes.set_axis_off()
    axes.set_title(short_name(model.name, 48), size=13, weight="bold", loc="left", pad=21, parse_math=False)
    says = f"{views} views{shown} · descriptor {model.descriptor} · digest {model.digest[:12]}"
    axes.text(0.0, 1.0, f"{says}\n", transform=axes.transAxes, size=9.5, color="0.3", va="center", parse_math=False)
