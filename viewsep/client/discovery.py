"""Finding rigs: sessions with endpoints, and the liveliness tokens of what is served there."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import zenoh

from viewsep.client.errors import BadReply, NoAnswer
from viewsep.errors import BadInput, ViewsepError
from viewsep.service.names import Keys
from viewsep.service.transport import client_session

CONNECT = ("tcp/127.0.0.1:7447",)
"""Where a service on this machine listens."""
CONNECT_IMAGES = ("tcp/127.0.0.1:7448",)
"""Where it listens for those who want pictures."""
_ALL_ADDRESSES = re.compile(r"/(0\.0\.0\.0|\[::\]):")
_RIG_NAME = re.compile(r"[A-Za-z0-9_.-]{1,64}")


@dataclass(frozen=True, slots=True)
class ServedRig:
    """A rig and the roles that are alive, sorted."""

    name: str
    roles: tuple[str, ...]


def rigs(
    connect: Sequence[str] = CONNECT, keys: str | None = None, certificate: str = "", timeout_s: float = 2.0
) -> list[ServedRig]:
    """The rigs that are served behind the endpoints, by name. Raises NoAnswer when no endpoint answers, BadInput."""
    session = open_session(connect, keys, certificate, timeout_s)
    try:
        return seen_rigs(session, timeout_s)
    finally:
        session.close()


def open_session(connect: Sequence[str], keys: str | None, certificate: str, timeout_s: float) -> zenoh.Session:
    """A client-mode session with the first endpoint that answers. Raises BadInput, NoAnswer."""
    try:
        return client_session(connect, Path(keys) if keys else None, certificate, timeout_s)
    except BadInput:
        raise
    except ViewsepError as error:
        raise NoAnswer(str(error)) from error


def check_rig_name(name: str) -> None:
    """Raises BadInput for a name that no rig can have."""
    if not _RIG_NAME.fullmatch(name):
        raise BadInput(f"rig {name!r}: a rig's name has up to 64 letters, digits and . _ -; `viewsep rigs` lists them")


def images_endpoints(manifest: Mapping[str, Any], connect: Sequence[str]) -> tuple[str, ...]:
    """Where a manifest says that pictures are to be had, CONNECT_IMAGES where it does not say.

    A rig that listens on all its addresses is reached by the host that `connect` begins with. Raises BadReply.
    """
    said = manifest.get("images", [])
    if not isinstance(said, list) or not all(isinstance(text, str) for text in said):
        raise BadReply(f"the manifest's 'images' = {said!r} is no list of endpoints: update viewsep")
    host = connect[0].split("/", 1)[1].rpartition(":")[0]
    return tuple(_ALL_ADDRESSES.sub(rf"/{host}:", text) for text in said) or CONNECT_IMAGES


def seen_rigs(session: zenoh.Session, timeout_s: float) -> list[ServedRig]:
    """The rigs whose liveliness tokens are seen, by name; none when nobody answers."""
    roles: dict[str, set[str]] = {}
    for reply in session.liveliness().get(Keys("*").alive("*"), timeout=timeout_s):
        if reply.ok is not None:
            _, rig, _, role = str(reply.ok.key_expr).split("/")
            roles.setdefault(rig, set()).add(role)
    return [ServedRig(rig, tuple(sorted(roles[rig]))) for rig in sorted(roles)]
