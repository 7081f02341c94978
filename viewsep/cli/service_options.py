"""Options of all commands that talk to a service, and the client they make."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from viewsep.client import CONNECT, Client
from viewsep.errors import BadInput

Rig = Annotated[str | None, typer.Option("--rig", help="Name of the rig.", show_default="the only one there is")]
Connect = Annotated[
    list[str] | None,
    typer.Option(
        "--connect",
        metavar="ENDPOINT",
        envvar="VIEWSEP_CONNECT",
        help="Endpoint of the service; may be given several times, the first that answers is used.",
        show_default=CONNECT[0],
    ),
]
KeysFolder = Annotated[
    Path | None, typer.Option("--keys", help="Folder of certificates.", show_default="none: loopback only")
]
Certificate = Annotated[str, typer.Option("--as", metavar="CERTIFICATE", help="Certificate to show, by name.")]
AnswerTimeout = Annotated[
    float, typer.Option("--timeout", min=0.1, max=600, help="Longest wait for an answer, seconds.")
]
Owner = Annotated[str, typer.Option("--owner", help="Who asks.", show_default="user@host")]
Json = Annotated[bool, typer.Option("--json", help="Print JSON.")]


def make_client(
    rig: str | None, connect: list[str] | None, keys: Path | None, certificate: str, timeout_s: float, owner: str = ""
) -> Client:
    """The client of these options; not opened yet."""
    return Client(rig, endpoints(connect), owner, keys_folder(keys), certificate, timeout_s)


def endpoints(connect: list[str] | None) -> tuple[str, ...]:
    """The endpoints to try."""
    return tuple(connect) if connect else CONNECT


def keys_folder(keys: Path | None) -> str | None:
    """The folder as the transport takes it."""
    return None if keys is None else str(keys)


def numbers(option: str, text: str, example: str, count: int | None = None) -> tuple[float, ...]:
    """Comma-separated numbers, `count` of them if given. Raises BadInput."""
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if not values or not all(map(math.isfinite, values)) or (count is not None and len(values) != count):
        raise BadInput(f"{option} {text!r}: write {example}")
    return values
