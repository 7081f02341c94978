"""`viewsep router`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from viewsep.cli.console import people
from viewsep.cli.serve import show_log
from viewsep.config import Config, load_config


def router(
    config: Annotated[
        Path | None, typer.Option(help="TOML configuration; of its [service] the endpoints and keys count.")
    ] = None,
) -> None:
    """Pass on what rigs and their clients say, so that clients need to know one endpoint, until Ctrl-C or SIGTERM.

    Rigs and engines name the router in `service.connect`, rigs also in `service.connect_images`; docs/deploy.md has an
    example. Without --config it listens on tcp/127.0.0.1:7447, and for pictures on port 7448. It logs who connects.

    Example:

        viewsep router --config router.toml
    """
    from viewsep.service.ending import Ending
    from viewsep.service.router import Router  # Zenoh is slow to import

    service = (load_config(config) if config else Config()).service
    show_log()
    ending = Ending()
    ending.on_signals()
    with Router(service):
        people.print(f"routing on {' '.join((*service.listen, *service.listen_images))}", soft_wrap=True)
        ending.wait()
