"""`viewsep recordings export`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from viewsep.camera_optics import in_metres, recorded_optics
from viewsep.cli.console import people, print_json, progress_bar, results
from viewsep.cli.service_options import Json
from viewsep.config import Config, geometry_of
from viewsep.errors import BadInput
from viewsep.models.aspect_graph import AspectGraph
from viewsep.recordings.camera_poses import ObjectPose, Optics, object_pose
from viewsep.recordings.export import PictureFormat, Pictures
from viewsep.recordings.export_estimates import export_estimates
from viewsep.recordings.export_scenes import export_bop, export_colmap, export_nerf, scene_of
from viewsep.recordings.export_views import export_views
from viewsep.recordings.reader import Recording, read_recording
from viewsep.recordings.replay import restore

UNIT_DISTANCE = "distances of the camera"


class Kind(StrEnum):
    """What a recording becomes."""

    VIEWS = "views"
    CSV = "csv"
    NERF = "nerf"
    COLMAP = "colmap"
    BOP = "bop"


SCENES = {Kind.NERF: export_nerf, Kind.COLMAP: export_colmap, Kind.BOP: export_bop}


def export(
    recording: Annotated[Path, typer.Argument(help="Recording (MCAP).", metavar="FILE", show_default=False)],
    kind: Annotated[Kind, typer.Option("--to", help="What to make of it.", show_default=False)],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder, or file of a csv.", show_default=False)],
    name: Annotated[
        str | None,
        typer.Option("--as", metavar="NAME", help="Candidate whose pose counts.", show_default="named or best"),
    ] = None,
    pictures: Annotated[
        PictureFormat | None, typer.Option(help="Recorded JPEGs as they are, or PNGs.", show_default="jpeg")
    ] = None,
    fov_deg: Annotated[
        float | None, typer.Option(help="Photos: angle that the picture's width covers.", show_default=False)
    ] = None,
    distance_m: Annotated[
        float | None, typer.Option(help="From the camera to the object's centre.", show_default=False)
    ] = None,
    force: Annotated[bool, typer.Option(help="Replace an earlier export.")] = False,
    json: Json = False,
) -> None:
    """Make something else of a recording.

    `views`: a view set to learn from, of the pictures that were used. `csv`: the estimates as a table. `nerf`,
    `colmap`, `bop`: all pictures with masks and the camera's poses around the object, for programs that read these.

    Examples:

        viewsep recordings export run.mcap --to views -o tea && viewsep learn tea -o library

        viewsep recordings export run.mcap --to csv -o run.csv

        viewsep recordings export run.mcap --to nerf --pictures png -o scene

        viewsep recordings export photos.mcap --to bop --fov-deg 40 --distance-m 0.6 -o 000000
    """
    _check_options(kind, name, pictures, fov_deg, distance_m)
    content = read_recording(recording)
    config, models = restore(content)
    with progress_bar() as bar:
        task = bar.add_task("exporting", total=None)
        writer = Pictures(pictures or PictureFormat.JPEG, lambda: bar.advance(task))
        if kind is Kind.CSV:
            exported = export_estimates(content, output, force)
        else:
            pose = object_pose(content, [model.name for model in models], name)
            if kind is Kind.VIEWS:
                exported = export_views(content, pose, output, writer, force)
            else:
                optics = _optics(kind, config, _held(content, models, pose), fov_deg, distance_m)
                scene = scene_of(content, geometry_of(config.rig), pose, optics)
                exported = SCENES[kind](scene, output, writer, force)
    what = "lines" if kind is Kind.CSV else "pictures"
    if json:
        print_json({"to": kind.value, "output": str(output), what: exported.count, "notes": exported.notes})
        return
    results.print(f"{exported.count} {what} -> {output}", soft_wrap=True, highlight=False, markup=False)
    for note in exported.notes:
        people.print(f"note: {note}", soft_wrap=True, highlight=False, markup=False)


def _check_options(
    kind: Kind, name: str | None, pictures: PictureFormat | None, fov_deg: float | None, distance_m: float | None
) -> None:
    """Raise BadInput for options that do not go with what is made, and for values out of range."""
    if kind is Kind.CSV and (name is not None or pictures is not None):
        raise BadInput(
            "--as and --pictures do not go with --to csv: its lines are all candidates' and without pictures"
        )
    if kind not in SCENES and (fov_deg is not None or distance_m is not None):
        raise BadInput(f"--fov-deg and --distance-m go with {', '.join(SCENES)}, not with --to {kind.value}")
    if fov_deg is not None and not 0.1 <= fov_deg <= 170.0:
        raise BadInput(f"--fov-deg {fov_deg:g}: give an angle of 0.1 to 170 degrees")
    if distance_m is not None and not (math.isfinite(distance_m) and distance_m > 0):
        raise BadInput(f"--distance-m {distance_m:g}: give metres above 0")


def _held(content: Recording, models: Sequence[AspectGraph], pose: ObjectPose) -> AspectGraph:
    """The model of what was in the holder, or, where that is not known, of the candidate it is taken for."""
    truth = content.metadata["task"].get("truth")
    return next((model for model in models if model.name == truth), models[pose.number - 1])


def _optics(kind: Kind, config: Config, held: AspectGraph, fov_deg: float | None, distance_m: float | None) -> Optics:
    """The camera: what the recording knows of it, and the options for the rest. Raises BadInput."""
    known = recorded_optics(config)
    if known is None:
        if fov_deg is None:
            raise BadInput("the recording shows photos and does not know their lens: give --fov-deg")
        if distance_m is None and kind is Kind.BOP:
            raise BadInput("--to bop needs lengths, and the recording shows photos: give --distance-m")
        fov_rad = math.radians(fov_deg)
        return Optics(fov_rad, 1.0, UNIT_DISTANCE) if distance_m is None else Optics(fov_rad, distance_m, "m")
    if fov_deg is not None:
        known_deg = math.degrees(known.fov_rad)
        raise BadInput(
            f"--fov-deg {fov_deg:g}: the recording's camera is the simulated one with {known_deg:g}: leave it out"
        )
    if distance_m is not None:
        return Optics(known.fov_rad, distance_m, "m")
    if kind is not Kind.BOP:
        return known
    scaled = in_metres(known, held)
    if scaled is None:
        raise BadInput(
            f"--to bop needs lengths, and the mesh that {held.name} was learned from ({held.provenance.source}) is not "
            "there any more: give --distance-m"
        )
    return scaled
