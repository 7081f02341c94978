"""A client of the viewsep service: status, requests, results, streams and pictures over Zenoh; see docs/service.md.

with Client("bench") as client:
    result = client.run(candidates=("tea", "tea_decaf"), seed=1)
    print(result.outcome, result.object, result.reason)
"""

from __future__ import annotations

from viewsep.client.client import Client, Stopped
from viewsep.client.discovery import CONNECT, CONNECT_IMAGES, ServedRig, rigs
from viewsep.client.errors import BadReply, NoAnswer, RequestRefused, TaskLost
from viewsep.client.streams import LogLine, Pictures, Received, Stream

__all__ = [
    "CONNECT",
    "CONNECT_IMAGES",
    "BadReply",
    "Client",
    "LogLine",
    "NoAnswer",
    "Pictures",
    "Received",
    "RequestRefused",
    "ServedRig",
    "Stopped",
    "Stream",
    "TaskLost",
    "rigs",
]
