"""All commands in one place. Each is imported when it is asked for: none waits for what only others need."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

import viewsep

COMMANDS = {
    "demo": "demo:demo",
    "learn": "learn:learn",
    "models": "models:app",
    "separate": "separate:separate",
    "serve": "serve:serve",
    "router": "router:router",
    "replay": "replay:replay",
    "report": "report:report",
    "recordings": "recordings:app",
    "rig": "rig:app",
    "rigs": "rigs:rigs",
    "camera": "camera:app",
    "status": "status:status",
    "start": "start:start",
    "watch": "watch:watch",
    "cancel": "requests:cancel",
    "stop": "requests:stop",
    "home": "requests:home",
    "move": "requests:move",
    "clear-fault": "requests:clear_fault",
    "request": "requests:request",
    "bench": "bench:app",
    "keys": "keys:app",
}
"""Where each command is: a module of this package and a function, or a group of further commands, in it."""


class Commands(TyperGroup):
    """A group that knows the names of its commands, and imports the one that is asked for."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        not_yet: Any = None
        self.commands.update(dict.fromkeys(COMMANDS, not_yet))

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """A command of Typer's; None for a name that no command has."""
        if cmd_name not in COMMANDS:
            return None
        module, name = COMMANDS[cmd_name].split(":")
        found: typer.Typer | Callable[..., None] = getattr(import_module(f"viewsep.cli.{module}"), name)
        alone = typer.Typer(rich_markup_mode="markdown")
        if isinstance(found, typer.Typer):
            alone.add_typer(found, name=cmd_name)
        else:
            alone.command(cmd_name)(found)
        return typer.main.get_group(alone).get_command(ctx, cmd_name)


app = typer.Typer(
    cls=Commands,
    help="Tell look-alike objects apart by turning them in front of a camera.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"viewsep {viewsep.__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Options of every command."""
