"""A task on a served rig, seen from here: the live table or JSON lines while it runs, then its result."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import Enum
from typing import Any

import numpy as np
from rich.text import Text

from viewsep.cli.console import people, print_json, print_json_line, results
from viewsep.cli.exit_codes import EXIT_CODES
from viewsep.cli.live import LiveTable
from viewsep.client import LogLine, Received
from viewsep.errors import ViewsepError
from viewsep.messages import Outcome
from viewsep.service.ending import Ending
from viewsep.service.status import ResultStatus

_QUIET = ("DEBUG", "INFO")


def show_in(table: LiveTable) -> Callable[[Received], None]:
    """Messages go to the table, warnings of the service to stderr."""

    def hear(received: Received) -> None:
        message = received.message
        if not isinstance(message, LogLine):
            table.hear(received.stamp_ns, message)
        elif message.level not in _QUIET:
            people.print(Text(f"{message.name}: {message.message}"))

    return hear


@contextmanager
def heard_ctrl_c() -> Iterator[Callable[[], bool]]:
    """Whether Ctrl-C was pressed since it was asked last: an exception could get lost in a callback of Zenoh's."""
    ending = Ending()
    with ending.while_on_signals():
        yield lambda: ending.wait(0.0)


def print_line(received: Received) -> None:
    """One JSON line per message."""
    print_json_line(as_json(received))


def as_json(received: Received) -> dict[str, Any]:
    """Topic, sequence, stamp and the message's own fields (radians, nanoseconds), with the kind of message."""
    message = received.message
    return {
        "topic": received.topic,
        "sequence": received.sequence,
        "stamp_ns": received.stamp_ns,
        "kind": type(message).__name__,
        "message": _plain({field.name: getattr(message, field.name) for field in dataclasses.fields(message)}),
    }


def _plain(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, np.ndarray):
        return value.tolist()
    if dataclasses.is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(inner) for inner in value]
    return value


def tell_result(result: ResultStatus, json: bool, *, line: bool = False) -> None:
    """The result as sentences, as JSON, or as the last of the JSON lines."""
    said = result.model_dump(mode="json")
    if line:
        print_json_line({"result": said})
    elif json:
        print_json(said)
    else:
        account = result.account
        pose = f", {account.pose}" if account.pose else ""
        results.print(Text(account.sentence), soft_wrap=True)
        results.print(f"{result.looks} looks, {result.travel_deg:.0f}° of travel{pose}", highlight=False)
        if result.recording:
            results.print(Text(f"recording: {result.recording}"), soft_wrap=True)


def exit_code(result: ResultStatus) -> int:
    """That of the outcome. Raises ViewsepError for one that this version does not know."""
    try:
        return EXIT_CODES[Outcome(result.outcome)]
    except ValueError:
        raise ViewsepError(f"task {result.task} ended as {result.outcome!r}: update viewsep") from None
