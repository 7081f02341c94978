"""`viewsep rig calibrate board`."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.table import Table

from viewsep.calibration.board import Board, RigPlacement, Sighting, placement_of, sight
from viewsep.calibration.lens import Lens
from viewsep.cli.board_options import Columns, Rows, SquareMm, board_of
from viewsep.cli.console import people, print_json, results
from viewsep.cli.service_options import Json
from viewsep.config import geometry_of, load_config
from viewsep.config_file import set_placement
from viewsep.errors import BadInput
from viewsep.geometry import angle_between
from viewsep.kinematics import RigGeometry
from viewsep.messages import Array, FloatArray

LIST = "angles.csv"
FIRST_GUESS_DEG = 40.0  # field of view of a lens that is not known
ASKEW_DEG = 3.0


def calibrate_board(
    folder: Annotated[Path, typer.Argument(help=f"Pictures of the board, and {LIST}.", show_default=False)],
    config: Annotated[Path, typer.Option(help="The rig's configuration.", show_default=False)],
    columns: Columns = 7,
    rows: Rows = 5,
    square_mm: SquareMm = 20.0,
    height_mm: Annotated[float, typer.Option(help="How far above the board the objects' centres will be.")] = 0.0,
    fov_deg: Annotated[
        float | None,
        typer.Option(min=5.0, max=150.0, help="Angle of view over the picture's smaller side.", show_default="fitted"),
    ] = None,
    keep: Annotated[bool, typer.Option("--keep", help="Leave the configuration as it is.")] = False,
    json: Json = False,
) -> None:
    """Find where the camera and the joints' axes are, from pictures of a printed board that lies on the plate.

    `angles.csv` beside the pictures has a column `image` and one for each joint, in degrees. Turn the joints one by
    one, each to four angles or more, and leave the others where they are in the first picture. The camera's elevation
    goes into the configuration, and the axes where its joints are written out; the file before is kept as FILE.bak.

    Examples:

        viewsep rig board --out board.pdf

        viewsep rig calibrate board pictures --config rig.toml --height-mm 60
    """
    settings = load_config(config)
    geometry = geometry_of(settings.rig)
    names = [limit.name for limit in geometry.limits]
    sightings, (high, wide) = _sightings(folder, names, board_of(columns, rows, square_mm))
    lens = Lens.seeing(float(np.radians(FIRST_GUESS_DEG if fov_deg is None else fov_deg)), wide, high)
    found = placement_of(sightings, lens, free_lens=fov_deg is None, height_m=height_mm / 1000.0)
    askew_deg = np.degrees(angle_between(found.axes, geometry.axes))
    if json:
        print_json(_as_dict(found, names, askew_deg))
    else:
        results.print(_table(found, names, askew_deg))
        said = _in_words(found, geometry)
        results.print(said, soft_wrap=True, highlight=False)
    written_out = bool(settings.rig.joints)
    for name, askew in zip(names, askew_deg, strict=True):
        if askew > 90.0 and not written_out:
            raise BadInput(
                f"joint {name!r} turns the other way than the rig {geometry.name!r} says: change the "
                "direction of its servo"
            )
        if askew > ASKEW_DEG and not written_out:
            people.print(
                f"joint {name!r} is {askew:.1f} deg askew: write the joints out as [[rig.joints]] "
                "(docs/config/wrist.toml) and calibrate again to have their axes stored",
                soft_wrap=True,
                highlight=False,
            )
    if not keep:
        elevation_deg = round(float(np.degrees(found.camera_elevation_rad)), 3)
        axes = np.round(found.axes, 5).tolist() if written_out else []
        backup = set_placement(config, elevation_deg, axes)
        people.print(
            f"camera_elevation_deg = {elevation_deg:g} (the file before is {backup})", soft_wrap=True, highlight=False
        )


def _sightings(folder: Path, names: Sequence[str], board: Board) -> tuple[list[Sighting], tuple[int, int]]:
    """What of the board is seen in the listed pictures, and their height and width. Raises BadInput."""
    found, size = [], None
    for where, image, position in _listed(folder / LIST, names):
        picture: Array | None = cv2.imread(str(folder / image), cv2.IMREAD_GRAYSCALE)
        if picture is None:
            raise BadInput(f"{where}: {image!r} in {folder} is no picture that can be read; correct the name")
        if size is not None and picture.shape[:2] != size:
            raise BadInput(
                f"{where}: {image!r} has another size than the pictures before; all must come from one camera"
            )
        size = (int(picture.shape[0]), int(picture.shape[1]))
        sighting = sight(board, picture, position)
        if sighting is None:
            people.print(f"{image}: too little of the board is seen, left out", soft_wrap=True, highlight=False)
        else:
            found.append(sighting)
    if size is None:
        raise BadInput(f"{folder / LIST}: lists no pictures")
    return found, size


def _listed(path: Path, names: Sequence[str]) -> list[tuple[str, str, list[float]]]:
    """Of every line of the list where it is, the image and the joint angles in radians. Raises BadInput."""
    try:
        text = path.read_text(encoding="utf-8-sig")
        lines = list(csv.reader(io.StringIO(text, newline=""), strict=True))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"cannot read the list of pictures {path}: {error}") from error
    columns = ["image", *names]
    if not lines or [cell.strip() for cell in lines[0]] != columns:
        raise BadInput(
            f"{path}, line 1: must name the columns {','.join(columns)}: the joints are those of the configuration"
        )
    listed = []
    for number, row in enumerate(lines[1:], start=2):
        where = f"{path}, line {number}"
        if not any(row):
            continue
        if len(row) != len(columns):
            raise BadInput(f"{where}: has {len(row)} cells for the columns {','.join(columns)}")
        try:
            position = np.radians([float(cell) for cell in row[1:]])
        except ValueError as error:
            raise BadInput(f"{where}: {error}; write joint angles in degrees, e.g. 22.5") from error
        if not np.isfinite(position).all():
            raise BadInput(f"{where}: joint angles must be finite; write degrees, e.g. 22.5")
        listed.append((where, row[0].strip(), position.tolist()))
    return listed


def _in_words(found: RigPlacement, geometry: RigGeometry) -> str:
    was = float(np.degrees(np.arcsin(geometry.camera_direction[2])))
    return (
        f"camera elevation {np.degrees(found.camera_elevation_rad):.2f} ± {np.degrees(found.elevation_margin_rad):.2f} "
        f"deg (configured: {was:.2f}), {found.residual_px:.2f} px off in {found.pictures} pictures, "
        f"focal length {found.lens.focal_px:.1f} px"
    )


def _table(found: RigPlacement, names: Sequence[str], askew_deg: FloatArray) -> Table:
    table = Table("joint", "axis x", "axis y", "axis z", "from configured deg")
    for name, axis, askew in zip(names, found.axes, askew_deg, strict=True):
        table.add_row(name, *(f"{value:.4f}" for value in axis), f"{askew:.2f}")
    return table


def _as_dict(found: RigPlacement, names: Sequence[str], askew_deg: FloatArray) -> dict[str, object]:
    return {
        "camera_elevation_deg": float(np.degrees(found.camera_elevation_rad)),
        "elevation_margin_deg": float(np.degrees(found.elevation_margin_rad)),
        "joints": [
            {"joint": name, "axis": axis.tolist(), "from_configured_deg": float(askew)}
            for name, axis, askew in zip(names, found.axes, askew_deg, strict=True)
        ],
        "centre_m": found.centre_m.tolist(),
        "focal_px": found.lens.focal_px,
        "residual_px": found.residual_px,
        "worst_px": found.worst_px,
        "pictures": found.pictures,
    }
