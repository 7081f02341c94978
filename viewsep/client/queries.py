"""Questions and their answers: JSON in, JSON or an error reply out."""

from __future__ import annotations

import json
from collections.abc import Iterable
from typing import Any, TypeVar

import zenoh
from pydantic import ValidationError

from viewsep.client.errors import BadReply, RequestRefused
from viewsep.service.names import JSON, STATUS_SCHEMA
from viewsep.service.status import Status

_SILENCE = b"Timeout"  # what zenoh itself puts in place of an answer that did not come
Value = TypeVar("Value")
Answer = dict[str, Any] | RequestRefused
"""A JSON object, or the refusal."""


def ask(
    session: zenoh.Session, key: str, timeout_s: float, request: bytes | None = None, everybody: bool = False
) -> list[Answer]:
    """The answers to the query `key` within `timeout_s`: of everybody who has one, or of the nearest alone.

    Raises BadReply for an answer that is not a JSON object.
    """
    replies = session.get(
        key,
        target=zenoh.QueryTarget.ALL if everybody else zenoh.QueryTarget.BEST_MATCHING,
        consolidation=zenoh.ConsolidationMode.NONE,
        timeout=timeout_s,
        payload=request,
        encoding=None if request is None else JSON,
    )
    return [answer for answer in (_answer(key, reply) for reply in replies) if answer is not None]


def _answer(key: str, reply: zenoh.Reply) -> Answer | None:
    if reply.ok is not None:
        return _table(key, reply.ok.payload.to_bytes())
    assert reply.err is not None
    payload = reply.err.payload.to_bytes()
    if payload == _SILENCE:
        return None
    table = _table(key, payload)
    if not isinstance(table.get("code"), str) or not isinstance(table.get("message"), str):
        raise BadReply(f"the error reply to {key} has no code and message: {_shown(payload)}; update viewsep")
    return RequestRefused(table["code"], table["message"])


def _table(key: str, payload: bytes) -> dict[str, Any]:
    try:
        table = json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise BadReply(f"the answer to {key} is not JSON: {_shown(payload)}; is it a viewsep service?") from error
    if not isinstance(table, dict):
        raise BadReply(f"the answer to {key} is not a JSON object: {_shown(payload)}; is it a viewsep service?")
    return table


def read_status(key: str, table: dict[str, Any]) -> Status:
    """The status in an answer. Raises BadReply where it is of another version or has fields of other types."""
    schema = table.get("schema")
    if schema != STATUS_SCHEMA:
        raise BadReply(f"the answer to {key} is {schema!r}, but this client reads {STATUS_SCHEMA!r}: update viewsep")
    try:
        return Status.model_validate(table)
    except ValidationError as error:
        first = error.errors()[0]
        field = ".".join(str(part) for part in first["loc"])
        raise BadReply(
            f"the answer to {key} cannot be read, field {field!r}: {first['msg']}; update viewsep"
        ) from error


def said(reply: dict[str, Any], field: str, kind: type[Value]) -> Value:
    """What an acceptance says in `field`. Raises BadReply where it is missing or of another type."""
    value = reply.get(field)
    if not isinstance(value, kind):
        raise BadReply(
            f"the reply to {reply.get('command')!r} has no {field!r}: {_shown(json.dumps(reply))}; update viewsep"
        )
    return value


def put_together(tables: Iterable[dict[str, Any]]) -> dict[str, Any]:
    """One table from those of several processes: objects and lists are joined, of anything else the first counts."""
    whole: dict[str, Any] = {}
    for table in tables:
        for name, value in table.items():
            known = whole.get(name)
            if isinstance(known, dict) and isinstance(value, dict):
                whole[name] = {**value, **known}
            elif isinstance(known, list) and isinstance(value, list):
                whole[name] = known + [item for item in value if item not in known]
            else:
                whole.setdefault(name, value)
    return whole


def _shown(payload: bytes | str) -> str:
    text = repr(payload if isinstance(payload, str) else payload.decode(errors="replace"))
    return text if len(text) <= 80 else text[:77] + "..."
