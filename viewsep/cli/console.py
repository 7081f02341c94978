"""Where text goes: results and JSON to stdout, everything said meanwhile to stderr."""

from __future__ import annotations

import json
from typing import Any

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

people = Console(stderr=True)
results = Console()
MAX_SEED = 2**62  # recordings keep seeds in 64 bits, and tasks count up from them


def progress_bar() -> Progress:
    """A progress bar with time left; it shows itself on terminals only."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=people, transient=True, disable=not people.is_terminal)


def print_json(value: Any) -> None:
    """One JSON document on stdout; infinite numbers become null."""
    typer.echo(json.dumps(_finite(value), indent=2))


def print_json_line(value: Any) -> None:
    """One JSON document on one line of stdout, at once; infinite numbers become null."""
    print(json.dumps(_finite(value)), flush=True)  # noqa: T201


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(inner) for inner in value]
    if isinstance(value, float) and not abs(value) < float("inf"):
        return None
    return value
