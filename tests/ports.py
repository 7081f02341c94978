"""Ports for servers of tests."""

from __future__ import annotations

import random
import socket

BELOW_OUTGOING = range(20_000, 32_000)  # the system takes ports of outgoing connections from above
_given: set[int] = set()


def free_port() -> int:
    """A port of 127.0.0.1 that nobody listens on, and that no connection takes before the server does."""
    while True:
        port = random.SystemRandom().choice(BELOW_OUTGOING)
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
        if port not in _given:
            _given.add(port)
            return port
