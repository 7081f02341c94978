"""Zenoh sessions as viewsep opens them: explicit endpoints, no multicast, no gossip."""

from __future__ import annotations

import json
from collections.abc import Sequence

import zenoh

from viewsep.errors import ViewsepError


def client_session(connect: Sequence[str], keys: str | None, certificate: str, timeout_s: float) -> zenoh.Session:
    """A session in client mode with the first of the endpoints `connect` that answers within `timeout_s`.

    Raises ViewsepError when none does.
    """
    del keys, certificate  # loopback only
    config = zenoh.Config()
    config.insert_json5("mode", json.dumps("client"))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("scouting/gossip/enabled", "false")
    config.insert_json5("connect/endpoints", json.dumps(list(connect)))
    config.insert_json5("connect/timeout_ms", str(int(timeout_s * 1000)))
    config.insert_json5("connect/exit_on_failure", "true")
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        raise ViewsepError(f"no answer from {', '.join(connect)}: not running, or not allowed") from error
