"""Queries and their answers. Whatever goes wrong while one is answered becomes an error reply, never an empty one."""

from __future__ import annotations

import logging
from collections.abc import Callable

import zenoh

from viewsep.errors import BadInput, RigError, ViewsepError
from viewsep.service.names import JSON
from viewsep.service.requests import REQUESTS, Code, Refused, parse_request, refused

log = logging.getLogger("viewsep.service")

Answer = Callable[[bytes], bytes]
"""From a query's payload to the reply's. Raises Refused, BadInput, RigError."""


def declare_answer(session: zenoh.Session, key: str, answer: Answer, encoding: str = JSON) -> zenoh.Queryable[None]:
    """Answer queries on `key`. The answer runs in a thread of Zenoh's: it must be quick and never close the session."""
    name = key.rsplit("/", 1)[1]

    def handle(query: zenoh.Query) -> None:
        with query:
            try:
                payload = answer(query.payload.to_bytes() if query.payload is not None else b"")
            except Exception as error:
                query.reply_err(refused(name, _refusal(error, key)), encoding=JSON)
            else:
                query.reply(key, payload, encoding=encoding)

    return session.declare_queryable(key, handle, complete=True)


def declare_refusals(session: zenoh.Session, commands: str) -> zenoh.Queryable[None]:
    """Refuse requests that nobody knows; `commands` is the key expression of all. Known ones are for who answers them.

    It is not `complete`, so that Zenoh prefers those that answer one key.
    """

    def handle(query: zenoh.Query) -> None:
        with query:
            name = str(query.key_expr).rsplit("/", 1)[1]
            if name in REQUESTS:
                return
            try:
                parse_request(name, b"")
            except Refused as error:
                query.reply_err(refused(name, error), encoding=JSON)

    return session.declare_queryable(commands, handle, complete=False)


def _refusal(error: Exception, key: str) -> Refused:
    """What went wrong, as a refusal. An unexpected error is logged: it is a bug."""
    if isinstance(error, Refused):
        return error
    if isinstance(error, BadInput):
        return Refused(Code.BAD_REQUEST, str(error))
    if isinstance(error, RigError):
        return Refused(Code.FAULT, str(error))
    if isinstance(error, ViewsepError):
        return Refused(Code.INTERNAL, str(error))
    log.error("%s could not be answered", key, exc_info=error)
    return Refused(Code.INTERNAL, f"{type(error).__name__}: {error}; this is a bug, the service's log says more")
