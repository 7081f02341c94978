"""Options that experiments share, and what they mean."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Annotated

import typer
from pydantic import ValidationError
from rich.progress import Progress

from viewsep.bench.experiment import Running
from viewsep.bench.journal import Row
from viewsep.bench.runner import Workers
from viewsep.cli.console import MAX_SEED
from viewsep.cli.plugin_option import onto, parse_plugin
from viewsep.config import Config, DescriptorConfig, SimConfig, TaskConfig, explain, load_config, parse_config
from viewsep.config_section import Section
from viewsep.errors import BadInput
from viewsep.sim.render_cache import RenderCache

Seed = Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the first task; the next ones count up from it.")]
ConfigFile = Annotated[Path | None, typer.Option(help="TOML configuration; see docs/config.")]
Disturb = Annotated[
    str | None,
    typer.Option(
        help="Disturbances of the simulated rig by their keys in the configuration: light=0.3,noise=0.05.",
        show_default="none",
    ),
]
Preset = Annotated[
    str | None, typer.Option("--rig", help="Rig preset: turntable, pan_tilt, wrist or gimbal.", show_default="gimbal")
]
DescriptorName = Annotated[
    str | None,
    typer.Option(
        "--descriptor",
        help="Feature of a view: NAME or NAME:key=value,...; several joined by +.",
        show_default="opponent+rings",
    ),
]
PoseTolerance = Annotated[
    float | None,
    typer.Option(
        "--pose-tolerance",
        metavar="DEG",
        help="A named object's pose must be known that well too (root mean squared angle, degrees).",
        show_default="the name is enough",
    ),
]
Jobs = Annotated[int, typer.Option(help="Local processes; -1 is one per core.")]
Scheduler = Annotated[
    str, typer.Option(help="Run on the Dask cluster of this scheduler instead: tcp://HOST:PORT (extra `cluster`).")
]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Write tasks and summary to this file.")]
PlotFolder = Annotated[Path | None, typer.Option("--plot", help="Draw the pictures into this folder.")]
Resume = Annotated[
    bool, typer.Option("--resume", help="Go on with the run into the same --json file that was stopped.")
]
CacheFolder = Annotated[
    Path | None, typer.Option("--cache", help="Folder of rendered pictures.", show_default="the user's cache folder")
]
CacheSize = Annotated[int, typer.Option(min=0, help="Largest size of that folder in MB; 0 keeps no pictures.")]
CACHE_MB = 2000


def configured(
    config: Path | None,
    rig: str | None,
    disturb: str | None,
    descriptor: str | None = None,
    pose_tolerance_deg: float | None = None,
    *,
    usual: Mapping[str, Section] | None = None,
) -> Config:
    """The configuration file (or the defaults) with what the command line says instead.

    `usual` are the experiment's own defaults, for sections that the file does not have. Raises BadConfig, BadInput.
    """
    settings = load_config(config) if config else Config()
    own = {name: section for name, section in (usual or {}).items() if name not in settings.model_fields_set}
    settings = settings.model_copy(update=own)
    if rig is not None:
        given = settings.model_dump(exclude_unset=True) | {"rig": {"preset": rig}}
        settings = parse_config(given, "--rig")
    if disturb is not None:
        settings = settings.model_copy(update={"sim": disturbances(disturb, settings.sim)})
    if descriptor is not None:
        chosen = onto(settings.descriptor, parse_plugin("descriptor", descriptor))
        settings = settings.model_copy(update={"descriptor": DescriptorConfig(**chosen)})
    if pose_tolerance_deg is not None:
        settings = settings.model_copy(update={"task": _tolerant(settings.task, pose_tolerance_deg)})
    return settings


def _tolerant(task: TaskConfig, pose_tolerance_deg: float) -> TaskConfig:
    try:
        return TaskConfig.model_validate(task.model_dump() | {"pose_tolerance_deg": pose_tolerance_deg})
    except ValidationError as error:
        raise BadInput(f"--pose-tolerance {pose_tolerance_deg:g}: {explain(error)}") from error


def disturbances(text: str, base: SimConfig) -> SimConfig:
    """`light=0.3,noise=0.05` on top of the configured ones. Raises BadInput naming key and value."""
    given: dict[str, float] = {}
    for part in text.split(","):
        key, _, value = (piece.strip() for piece in part.partition("="))
        try:
            given[key] = float(value)
        except ValueError:
            raise BadInput(f"--disturb {part!r}: write KEY=NUMBER, e.g. light=0.3,noise=0.05") from None
    try:
        return SimConfig.model_validate(base.model_dump() | given)
    except ValidationError as error:
        known = ", ".join(key for key in SimConfig.model_fields if key != "placed")
        raise BadInput(f"--disturb {text!r}: {explain(error)} (there are {known})") from None


def listed(text: str | None, option: str) -> list[str]:
    """Names from a comma-separated option, none for None. Raises BadInput for empty or repeated names."""
    if text is None:
        return []
    names = [name.strip() for name in text.split(",")]
    if not all(names) or len(set(names)) < len(names):
        raise BadInput(f"{option} {text!r}: separate different names by single commas")
    return names


def cache_of(folder: Path | None, megabytes: int) -> RenderCache | None:
    """Where rendered pictures are kept."""
    return RenderCache(folder, megabytes * 10**6) if megabytes > 0 else None


def check_plot(folder: Path | None) -> None:
    """Make the folder for pictures now: nobody wants to hear after an hour that it cannot be. Raises BadInput."""
    if folder is not None:
        from viewsep.plots.bench import make_folder  # matplotlib is slow to import

        make_folder(folder)


def running(jobs: int, scheduler: str, json: Path | None, resume: bool, bars: Progress) -> Running:
    """How the experiment is carried out, with a bar for each of its parts. Raises BadInput."""
    if resume and json is None:
        raise BadInput("--resume goes on with what is kept beside a result: give the same --json FILE as before")
    if json is not None and not json.parent.is_dir():
        raise BadInput(f"--json {json}: there is no folder {json.parent}; make it first")

    def begin(what: str, rows: int) -> Callable[[Row], None]:
        bar = bars.add_task(what, total=rows)
        return lambda _row: bars.advance(bar)

    return Running(Workers(jobs, scheduler), begin, json, resume)
