"""A router between clients and several rigs: who knows its endpoint alone reaches all of them."""

from __future__ import annotations

from contextlib import ExitStack

from viewsep.config import ServiceConfig
from viewsep.service.transport import Connections, logged, serving_session


class Router:
    """Passes on what rigs, engines and their clients say; pictures by a session of their own. A context manager.

    It listens, connects and controls access as a serving process does, but answers nothing itself. Raises BadInput on
    entering when it cannot listen, BadConfig for endpoints and keys that cannot be used.
    """

    def __init__(self, service: ServiceConfig) -> None:
        self._service = service
        self._open = ExitStack()

    def __enter__(self) -> Router:
        service = self._service
        with ExitStack() as opening:
            for name, listen, connect in (
                ("control", service.listen, service.connect),
                ("images", service.listen_images, service.connect_images),
            ):
                session = serving_session(service, listen, connect, mode="router")
                opening.callback(session.close)
                opening.callback(Connections(session, logged(name)).undeclare)
            self._open = opening.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()
