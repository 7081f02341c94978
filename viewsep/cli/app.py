"""All commands in one place."""

from __future__ import annotations

from typing import Annotated

import typer

from viewsep import __version__
from viewsep.cli import (
    bench,
    demo,
    keys,
    learn,
    models,
    replay,
    report,
    requests,
    rigs,
    separate,
    serve,
    start,
    status,
    watch,
)

app = typer.Typer(
    help="Tell look-alike objects apart by turning them in front of a camera.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command("demo")(demo.demo)
app.command("learn")(learn.learn)
app.command("models")(models.models)
app.command("separate")(separate.separate)
app.command("serve")(serve.serve)
app.command("replay")(replay.replay)
app.command("report")(report.report)
app.command("rigs")(rigs.rigs)
app.command("status")(status.status)
app.command("start")(start.start)
app.command("watch")(watch.watch)
app.command("cancel")(requests.cancel)
app.command("stop")(requests.stop)
app.command("home")(requests.home)
app.command("move")(requests.move)
app.command("clear-fault")(requests.clear_fault)
app.command("request")(requests.request)
app.add_typer(bench.app, name="bench")
app.add_typer(keys.app, name="keys")


def _print_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"viewsep {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Options of every command."""
