"""`viewsep cancel`, `stop`, `home`, `move`, `clear-fault` and `request`: one request, one answer."""

from __future__ import annotations

import json as json_text
from typing import Annotated, Any

import typer

from viewsep.cli.console import print_json, results
from viewsep.cli.service_options import (
    AnswerTimeout,
    Certificate,
    Connect,
    Json,
    KeysFolder,
    Owner,
    Rig,
    make_client,
    numbers,
)
from viewsep.client import Client
from viewsep.errors import BadInput

Reason = Annotated[str, typer.Option(help="Why, for the log and the result.")]
Wait = Annotated[bool, typer.Option("--wait", help="Stay until the joints stand still; Ctrl-C stops them.")]


def cancel(
    rig: Rig = None,
    connect: Connect = None,
    keys: KeysFolder = None,
    certificate: Certificate = "",
    timeout_s: AnswerTimeout = 2.0,
    owner: Owner = "",
    reason: Reason = "",
    json: Json = False,
) -> None:
    """End the running task in good order; only who started it may (see --owner).

    Exit codes: 0 cancelled, 1 refused or no answer, 2 bad input.

    Example:

        viewsep cancel --reason "wrong object"
    """
    with make_client(rig, connect, keys, certificate, timeout_s, owner) as client:
        client.cancel(reason)
    _say(json, "cancelled", {"accepted": True})


def stop(
    rig: Rig = None,
    connect: Connect = None,
    keys: KeysFolder = None,
    certificate: Certificate = "",
    timeout_s: AnswerTimeout = 2.0,
    owner: Owner = "",
    reason: Reason = "",
    json: Json = False,
) -> None:
    """Stop the motion where it is and end whatever runs, whoever started it.

    Exit codes: 0 at least one role stopped (which one did not answer is said), 1 none did, 2 bad input.

    Example:

        viewsep stop --rig bench
    """
    with make_client(rig, connect, keys, certificate, timeout_s, owner) as client:
        stopped = client.stop(reason)
    silent = f"; no answer from: {', '.join(stopped.silent)}" if stopped.silent else ""
    said = {"accepted": True, "stopped": list(stopped.roles), "silent": list(stopped.silent)}
    _say(json, f"stopped: {', '.join(stopped.roles)}{silent}", said)


def home(
    rig: Rig = None,
    connect: Connect = None,
    keys: KeysFolder = None,
    certificate: Certificate = "",
    timeout_s: AnswerTimeout = 2.0,
    owner: Owner = "",
    wait: Wait = False,
    json: Json = False,
) -> None:
    """Drive all joints to their home position.

    Exit codes: 0 accepted (with --wait: arrived), 1 refused, stopped or no answer, 2 bad input, 130 interrupted.

    Example:

        viewsep home --wait
    """
    with make_client(rig, connect, keys, certificate, timeout_s, owner) as client:
        _drive(client, client.home(detach=not wait), wait, json)


def move(
    rig: Rig = None,
    connect: Connect = None,
    keys: KeysFolder = None,
    certificate: Certificate = "",
    timeout_s: AnswerTimeout = 2.0,
    owner: Owner = "",
    joints: Annotated[str | None, typer.Option(help="Joint angles in degrees, comma-separated.")] = None,
    view: Annotated[str | None, typer.Option(metavar="AZ,EL", help="View direction in degrees.")] = None,
    wait: Wait = False,
    json: Json = False,
) -> None:
    """Drive the joints to angles, or to where a view direction of the control frame faces the camera.

    Exit codes: 0 accepted (with --wait: arrived), 1 refused, stopped or no answer, 2 bad input or out of reach, 130
    interrupted.

    Examples:

        viewsep move --joints 10,-20 --wait

        viewsep move --view 90,30
    """
    if (joints is None) == (view is None):
        raise BadInput("give --joints or --view, and not both: e.g. --view 90,30")
    angles = None if joints is None else numbers("--joints", joints, "one number per joint, e.g. --joints 10,-20")
    direction = None
    if view is not None:
        azimuth, elevation = numbers("--view", view, "azimuth and elevation, e.g. --view 90,30", 2)
        direction = (azimuth, elevation)
    with make_client(rig, connect, keys, certificate, timeout_s, owner) as client:
        _drive(client, client.move(angles, direction, detach=not wait), wait, json)


def clear_fault(
    rig: Rig = None,
    connect: Connect = None,
    keys: KeysFolder = None,
    certificate: Certificate = "",
    timeout_s: AnswerTimeout = 2.0,
    owner: Owner = "",
    json: Json = False,
) -> None:
    """Clear the faults of the motion.

    Exit codes: 0 cleared, 1 refused or no answer, 2 bad input.

    Example:

        viewsep clear-fault
    """
    with make_client(rig, connect, keys, certificate, timeout_s, owner) as client:
        client.clear_fault()
    _say(json, "cleared", {"accepted": True})


def request(
    command: Annotated[str, typer.Argument(help="Name of the request, as in docs/service.md.", show_default=False)],
    fields: Annotated[str, typer.Argument(metavar="JSON", help="Its fields as a JSON object.")] = "{}",
    rig: Rig = None,
    connect: Connect = None,
    keys: KeysFolder = None,
    certificate: Certificate = "",
    timeout_s: AnswerTimeout = 2.0,
    owner: Owner = "",
) -> None:
    """Send any request of docs/service.md and print the reply as JSON.

    Exit codes: 0 accepted, 1 refused or no answer, 2 bad input.

    Examples:

        viewsep request record '{"enabled": false}'

        viewsep request learn '{"source": "meshes/tea", "name": "tea"}'
    """
    try:
        table = json_text.loads(fields)
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{fields!r} is not JSON ({error}): write e.g. '{{\"enabled\": true}}'") from None
    if not isinstance(table, dict):
        raise BadInput(f"{fields!r} is not a JSON object: write e.g. '{{\"enabled\": true}}'")
    if not command or any(letter in command for letter in "/*$?# "):
        raise BadInput(f"{command!r} cannot be the name of a request: docs/service.md lists them")
    with make_client(rig, connect, keys, certificate, timeout_s, owner) as client:
        print_json(client.request(command, table))


def _drive(client: Client, setpoint_deg: tuple[float, ...], wait: bool, json: bool) -> None:
    """Tell where the joints go, and wait for it if asked to. Ctrl-C stops them when the client closes."""
    angles = ", ".join(f"{angle:.2f}" for angle in setpoint_deg)
    if wait:
        client.settle(setpoint_deg)
    said = {"accepted": True, "setpoint_deg": list(setpoint_deg), "settled": wait}
    _say(json, f"{'at' if wait else 'on the way to'} {angles} deg", said)


def _say(json: bool, sentence: str, said: dict[str, Any]) -> None:
    if json:
        print_json(said)
    else:
        results.print(sentence, highlight=False, markup=False, soft_wrap=True)
