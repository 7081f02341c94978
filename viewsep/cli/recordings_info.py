"""`viewsep recordings info`."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.markup import escape
from rich.table import Table

from viewsep.account import Account, pose_spread_deg, telling_view_deg
from viewsep.cli.console import people, print_json, results
from viewsep.cli.service_options import Json
from viewsep.config import Config, geometry_of
from viewsep.errors import BadRecording
from viewsep.recordings.codec import IMAGE_TOPIC
from viewsep.recordings.contents import PART, Contents, State, look_into

Files = Annotated[list[Path], typer.Argument(help="Recordings (MCAP).", metavar="FILE...", show_default=False)]


def info(files: Files, json: Json = False) -> None:
    """What is in recordings: who made them, on which rig, with which candidates, how they ended, and every topic.

    Of a damaged or unfinished recording it tells what stands before the damage.

    Exit codes: 0 all are whole, 1 one is damaged or unfinished, 2 one is no recording of viewsep's.

    Examples:

        viewsep recordings info run.mcap

        viewsep recordings info recordings/*.mcap --json
    """
    found: list[dict[str, Any]] = []
    code = 0
    for path in files:
        try:
            contents = look_into(path)
        except BadRecording as error:
            if len(files) == 1:
                raise
            people.print(f"viewsep: {error}", soft_wrap=True, markup=False)
            found.append({"file": str(path), "state": "no recording", "problem": str(error)})
            code = error.exit_code
            continue
        found.append(_as_dict(contents))
        if contents.state is not State.WHOLE:
            code = max(code, 1)
        if not json:
            _tell(contents)
    if json:
        print_json(found)
    raise typer.Exit(code)


def _as_dict(contents: Contents) -> dict[str, Any]:
    """For JSON: seconds since the first message, degrees, wall clock in UTC."""
    result, span = contents.result, contents.span_ns
    return {
        "file": str(contents.path),
        "bytes": contents.size,
        "state": contents.state.value,
        "problem": contents.problem or None,
        "viewsep": contents.build.get("viewsep"),
        "build": contents.build,
        "began": _began(contents),
        "duration_s": (span[1] - span[0]) / 1e9 if span else None,
        "rig": _rig(contents.config),
        "candidates": [{"name": name, "digest": digest} for name, digest in contents.candidates],
        "seed": contents.seed,
        "truth": contents.truth or None,
        "outcome": result.outcome.value if result else None,
        "object": result.object or None if result else None,
        "reason": result.reason if result else None,
        "indistinct": list(result.indistinct) if result else None,
        "telling_view_deg": telling_view_deg(result) if result else None,
        "pose_spread_deg": pose_spread_deg(result) if result else None,
        "looks": result.looks if result else None,
        "travel_deg": float(np.degrees(result.travel_rad)) if result else None,
        "topics": [
            {
                "topic": topic.name,
                "schema": topic.schema,
                "messages": topic.messages,
                "first_s": (topic.first_ns - span[0]) / 1e9 if span and topic.messages else None,
                "last_s": (topic.last_ns - span[0]) / 1e9 if span and topic.messages else None,
                "rate_hz": topic.rate_hz,
                "bytes": topic.size,
                "read_by_viewsep": topic.ours,
            }
            for topic in contents.topics
        ],
        "pictures": [
            {"width_px": width, "height_px": height, "pictures": count}
            for (width, height), count in contents.pictures.items()
        ],
        "pictures_hz": next((topic.rate_hz for topic in contents.topics if topic.name == IMAGE_TOPIC), None),
        "attachments": [
            {"name": name, "media_type": media_type, "bytes": size} for name, media_type, size in contents.attachments
        ],
    }


def _began(contents: Contents) -> str | None:
    if contents.began_unix_ns is None:
        return None
    return datetime.fromtimestamp(contents.began_unix_ns / 1e9, UTC).isoformat(timespec="milliseconds")


def _rig(config: Config | None) -> dict[str, Any] | None:
    if config is None:
        return None
    geometry = geometry_of(config.rig)
    joints = [limit.name for limit in geometry.limits]
    return {"name": geometry.name, "joints": joints, "backend": config.rig.backend}


def _tell(contents: Contents) -> None:
    """The same for people."""
    said = _as_dict(contents)
    state = "whole" if contents.state is State.WHOLE else f"[bold red]{contents.state.value}[/bold red]"
    results.print(f"[bold]{escape(said['file'])}[/bold]: {state}, {contents.size:,} bytes", soft_wrap=True)
    for name, text in _lines(contents, said):
        results.print(f"  {name:<12}{text}", soft_wrap=True, highlight=False, markup=False)
    table = Table("topic", "messages", "first s", "last s", "per s", "bytes")
    for topic in said["topics"]:
        numbers = (_number(topic[key], 3) for key in ("first_s", "last_s"))
        name = topic["topic"] if topic["read_by_viewsep"] else f"{topic['topic']} (for viewers)"
        table.add_row(
            escape(name), f"{topic['messages']:,}", *numbers, _number(topic["rate_hz"], 2), f"{topic['bytes']:,}"
        )
    if said["topics"]:
        results.print(table)


def _lines(contents: Contents, said: dict[str, Any]) -> list[tuple[str, str]]:
    """What is said of it line by line."""
    lines = []
    if contents.problem:
        lines = [("problem", contents.problem), ("", _remedy(contents)), ("", "before the damage it holds:")]
    elif contents.path.suffix == PART:
        lines = [("note", f"it is complete, only its name is not: rename it to {contents.path.stem}")]
    build, rig = contents.build, said["rig"]
    if build:
        rest = ", ".join(f"{name} {version}" for name, version in build.items() if name != "viewsep")
        lines.append(("made by", f"viewsep {build.get('viewsep', '?')} ({rest})"))
    began = "at an unknown time" if said["began"] is None else f"{said['began'][:-6].replace('T', ' ')} UTC"
    lines.append(("began", began + ("" if said["duration_s"] is None else f", lasted {said['duration_s']:.3f} s")))
    if rig:
        lines.append(("rig", f"{rig['name']} ({rig['backend']}), joints {', '.join(rig['joints'])}"))
    for number, (name, digest) in enumerate(contents.candidates):
        lines.append(("candidates" if number == 0 else "", f"{name} {digest[:12]}"))
    if contents.seed is not None:
        lines.append(("seed", str(contents.seed)))
    if contents.truth:
        lines.append(("truth", contents.truth))
    lines.append(("outcome", _outcome(contents)))
    if contents.pictures:
        rate = "" if said["pictures_hz"] is None else f", {said['pictures_hz']:.2f} per second"
        sizes = (f"{count:,} of {width} x {height} pixels" for (width, height), count in contents.pictures.items())
        lines.append(("pictures", ", ".join(sizes) + rate))
    for number, (name, _, size) in enumerate(contents.attachments):
        lines.append(("attachments" if number == 0 else "", f"{name}, {size:,} bytes"))
    return lines


def _remedy(contents: Contents) -> str:
    saved = f"`viewsep recordings recover {contents.path}` saves what can be read"
    if contents.state is State.UNFINISHED:
        return f"it may still be recorded to; if not, {saved}"
    return f"take a whole copy where there is one; {saved}"


def _outcome(contents: Contents) -> str:
    result = contents.result
    if result is None:
        return "none recorded"
    account = Account.of(result)
    took = f"{result.looks} looks, {np.degrees(result.travel_rad):.0f} deg of travel"
    pose = f", {account.pose}" if account.pose else ""
    return f"{account.ending}: {account.grounds} ({took}{pose})"


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
