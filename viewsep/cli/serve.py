"""`viewsep serve`."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated

import typer
from rich.logging import RichHandler

from viewsep.cli.console import MAX_SEED, people
from viewsep.config import Config, load_config, parse_config
from viewsep.service.names import Role


def serve(
    config: Annotated[Path | None, typer.Option(help="TOML configuration; see docs/config and docs/deploy.md.")] = None,
    role: Annotated[Role | None, typer.Option(help="What this process does.", show_default="both")] = None,
    models: Annotated[Path | None, typer.Option(help="Library folder.", show_default="library")] = None,
    source: Annotated[
        str | None, typer.Option("--object", help="What the simulated rig holds.", show_default="generated:7")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, max=MAX_SEED, help="Seed of the simulated rig's grasp.", show_default="0")
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(help="Simulated seconds per second; 0: time passes only in tasks.", show_default="1"),
    ] = None,
    recordings: Annotated[Path | None, typer.Option(help="Folder of recordings.", show_default="recordings")] = None,
) -> None:
    """Serve a rig on Zenoh: status, requests and streams, until Ctrl-C or SIGTERM. The rig then holds its position.

    Without --config it serves the simulated rig on tcp/127.0.0.1:7447, for this computer only.

    Examples:

        viewsep serve --models library --object generated:7

        viewsep serve --config rig.toml --role rig
    """
    from viewsep.service.rig_setup import served_rig  # Zenoh is slow to import
    from viewsep.service.serve import Service

    settings = _overridden(
        load_config(config) if config else Config(),
        library=str(models) if models else None,
        holds=source,
        seed=seed,
        speed=speed,
        recordings=str(recordings) if recordings else None,
    )
    show_log()
    served = None if role is Role.ENGINE else served_rig(settings)
    service = Service(settings, served, engine=role is not Role.RIG, config_file=config)
    service.ending.on_signals()
    with service:
        at = " ".join(settings.service.listen)
        people.print(f"serving {settings.service.name} ({', '.join(service.roles)}) on {at}", soft_wrap=True)
        service.ending.wait()


def _overridden(config: Config, **options: object) -> Config:
    """The configuration with those of its `service` options that were given. Raises BadConfig."""
    given = {key: value for key, value in options.items() if value is not None}
    table = config.model_dump(exclude_unset=True)
    table["service"] = table.get("service", {}) | given
    return parse_config(table, "the command line")


def show_log() -> None:
    """What the service does, for people, on stderr."""
    log = logging.getLogger("viewsep.service")
    log.setLevel(logging.INFO)
    log.addHandler(RichHandler(console=people, show_path=False, show_time=people.is_terminal))
