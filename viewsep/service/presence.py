"""Who is there: liveliness tokens under one key, and a call when one of them disappears."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import zenoh

from viewsep.service.requests import Code, Refused

ARRIVAL_S = 1.0


class Presence:
    """The last parts of all liveliness keys that match `key_expr`. `on_gone` is called from a thread of Zenoh's."""

    def __init__(self, session: zenoh.Session, key_expr: str, on_gone: Callable[[str], None]) -> None:
        self._on_gone = on_gone
        self._changed = threading.Condition()
        self._there: set[str] = set()
        self._subscriber = session.liveliness().declare_subscriber(key_expr, self._notice, history=True)

    def names(self) -> tuple[str, ...]:
        """All that are there now."""
        with self._changed:
            return tuple(sorted(self._there))

    def arrived(self, name: str, timeout_s: float = ARRIVAL_S) -> bool:
        """Whether `name` is there; its token may be a little later than a request that names it."""
        deadline = time.monotonic() + timeout_s
        with self._changed:
            while name not in self._there:
                remaining = deadline - time.monotonic()
                if remaining <= 0:
                    return False
                self._changed.wait(remaining)
            return True

    def close(self) -> None:
        """Watch no longer."""
        self._subscriber.undeclare()

    def _notice(self, sample: zenoh.Sample) -> None:
        name = str(sample.key_expr).rsplit("/", 1)[1]
        with self._changed:
            if sample.kind == zenoh.SampleKind.PUT:
                self._there.add(name)
            else:
                self._there.discard(name)
            self._changed.notify_all()
        if sample.kind != zenoh.SampleKind.PUT:
            self._on_gone(name)


def check_present(token: str, present: Callable[[str], bool]) -> None:
    """A request that is tied to somebody's liveliness needs it to be there. Raises Refused."""
    if token and not present(token):
        raise Refused(
            Code.BAD_REQUEST,
            f"field 'token' = {token!r}: there is no liveliness token of that name; declare it before the request, "
            "or leave the field out",
        )
