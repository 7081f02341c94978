"""From settings to Zenoh sessions: who may be reached, who may connect, and what is kept off the network.

Without keys everything stays on this computer's loopback addresses. With keys every link is mutual TLS, and a serving
session lets everybody do what the register says, see `viewsep.service.access`.
"""

from __future__ import annotations

import json
import logging
import os
import re
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from ipaddress import ip_address
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, Literal

import zenoh

from viewsep.errors import BadConfig, BadInput, RigError
from viewsep.keys import CA, REGISTER, check_certificate, is_dns_name, read_register
from viewsep.service.access import access_control

if TYPE_CHECKING:  # clients are quick to start without it
    from viewsep.config import ServiceConfig

log = logging.getLogger("viewsep.service")
MAX_MESSAGE_BYTES = 8 * 2**20
"""More than any picture: 1024 x 1024 pixels of noise are 3.3 MB as a JPEG of quality 98. Larger messages are lost."""
LEASE_MS = 2000
"""A link that is silent for so long is dead; keep-alives are four times as frequent."""
_QUEUE = {
    "size": {"data": 16, "data_low": 2},  # batches of 64 kB: what is reliable fits into them for longer than a lease
    "congestion_control": {"block": {"wait_before_close": 200_000}},  # microseconds that a full queue stops everybody
}
SECURE = ("tls", "quic")
THREADS = "(rx: (worker_threads: 8), tx: (worker_threads: 8), net: (worker_threads: 8))"
"""Of Zenoh, per kind of work. A link to somebody who stands still blocks one thread of a kind while it is closed, and
with the one or two that Zenoh has by default nobody else is answered meanwhile."""
_RETRY = {"period_init_ms": 100, "period_max_ms": 500, "period_increase_factor": 2}
_ENDPOINT = re.compile(r"(?P<protocol>[a-z]+)/(?P<host>\[[0-9A-Fa-f:.]+\]|[A-Za-z0-9.-]+):(?P<port>[0-9]{1,5})")
_REASON = re.compile(r"([A-Z][A-Za-z ]+) \(os error \d+\)")


class NoAnswer(RigError):
    """Nobody answers at an endpoint. Zenoh does not tell whether nobody is there or we are not allowed to ask."""

    def __init__(self, connect: Sequence[str]) -> None:
        super().__init__(f"no answer from {' or '.join(connect)}: not running, or not allowed")


@dataclass(frozen=True, slots=True)
class Endpoint:
    """`protocol/host:port`; the host is a DNS name, an IPv4 address, or an IPv6 address without its brackets."""

    protocol: str
    host: str
    port: int

    @property
    def loopback(self) -> bool:
        """Whether nothing but this computer can reach it."""
        try:
            address = ip_address(self.host)
        except ValueError:
            found = _resolved(self.host)
            return self.host == "localhost" and bool(found) and all(ip_address(each).is_loopback for each in found)
        return address.is_loopback and getattr(address, "ipv4_mapped", None) is None


def parse_endpoint(text: str, key: str) -> Endpoint:
    """Read `protocol/host:port`, nothing more: no `?` metadata, no `#` options. Raises BadConfig naming `key`."""
    wrong = BadConfig(f"key {key!r} = {text!r} is no endpoint: write tcp/127.0.0.1:7447 or tls/rig.example.org:7447")
    match = _ENDPOINT.fullmatch(text)
    if match is None or int(match["port"]) > 65535:
        raise wrong
    host = match["host"]
    if host.startswith("["):
        host = host[1:-1]
    elif is_dns_name(host):
        return Endpoint(match["protocol"], host, int(match["port"]))
    try:
        address = ip_address(host)
    except ValueError:
        raise wrong from None
    if (address.version == 6) != match["host"].startswith("["):
        raise wrong
    return Endpoint(match["protocol"], host, int(match["port"]))


def check_endpoint(text: str, key: str, secure: bool) -> Endpoint:
    """An endpoint that may be used: tls or quic with keys, tcp on a loopback address without. Raises BadConfig."""
    endpoint = parse_endpoint(text, key)
    if secure and endpoint.protocol not in SECURE:
        raise BadConfig(
            f"key {key!r} = {text!r}: with keys only tls/ and quic/ are used: write tls/{text.split('/', 1)[1]}"
        )
    if not secure and endpoint.protocol in SECURE:
        raise BadConfig(f"key {key!r} = {text!r}: {endpoint.protocol} needs keys: make them with `viewsep keys init`")
    if not secure and endpoint.protocol != "tcp":
        raise BadConfig(
            f"key {key!r} = {text!r}: use tcp on a loopback address, or tls with keys (`viewsep keys init`)"
        )
    if not secure and not endpoint.loopback:
        raise BadConfig(
            f"key {key!r} = {text!r}: without keys anybody could listen in or pose as the rig, so only tcp/127.0.0.1, "
            "tcp/[::1] and tcp/localhost are used: make keys with `viewsep keys init` and use tls"
        )
    return endpoint


def serving_session(
    service: ServiceConfig,
    listen: Sequence[str],
    connect: Sequence[str],
    mode: Literal["peer", "router"] = "peer",
) -> zenoh.Session:
    """A peer, or a router, that listens and keeps connecting to others in the background, there yet or not.

    Raises BadConfig for endpoints and keys that cannot be used, BadInput when it cannot listen.
    """
    keys = Path(service.keys) if service.keys else None
    for text in listen:
        check_endpoint(text, _key_of(text, service), keys is not None)
    key = "service.connect_images" if connect and connect == service.connect_images else "service.connect"
    _check_connect(connect, key, keys is not None)
    settings = _settings(mode, listen, connect, keys, service.certificate)
    settings["connect"] |= {"timeout_ms": -1, "exit_on_failure": False}
    settings["listen"] |= {"timeout_ms": 0, "exit_on_failure": True}
    if keys:
        settings["access_control"] = _access_control(keys, service.certificate)
    try:
        return _open(settings)
    except zenoh.ZError as error:
        said = str(error)
        where = next((text for text in listen if text.split("/", 1)[1] in said), ", ".join(listen))
        reason = _REASON.search(said)
        raise BadInput(
            f"cannot listen on {where}: {reason[1] if reason else said.split(' at /', 1)[0]}; "
            "end what uses it, or choose another endpoint"
        ) from error


def client_session(connect: Sequence[str], keys: Path | None, certificate: str, timeout_s: float) -> zenoh.Session:
    """A client of one or several serving sessions. Raises NoAnswer after `timeout_s`, BadConfig for bad settings."""
    if not connect:
        raise BadConfig("no endpoint to connect to: write tcp/127.0.0.1:7447")
    _check_connect(connect, "connect", keys is not None)
    settings = _settings("client", (), connect, keys, certificate)
    settings["connect"] |= {"timeout_ms": max(1, round(timeout_s * 1000)), "exit_on_failure": True}
    try:
        return _open(settings)
    except zenoh.ZError as error:
        raise NoAnswer(connect) from error


def logged(session: str) -> Callable[[str, bool], None]:
    """For `Connections`: a line in the service's log for everybody who comes or goes; `session` says where."""
    return lambda name, came: log.info("%s %s (%s)", name, "connected" if came else "disconnected", session)


class Connections:
    """Who is connected to a session: the name in the certificate, or the address where there are no keys.

    `changed(name, True)` is called when a link comes and `changed(name, False)` when it goes, from a thread of Zenoh's:
    it must be quick and must not close the session. Those connected already are told first.
    """

    def __init__(self, session: zenoh.Session, changed: Callable[[str, bool], None]) -> None:
        self._changed = changed
        self._links: dict[tuple[str, str, str], str] = {}
        self._lock = Lock()
        self._listener: Any = session.info.declare_link_events_listener(self._hear, history=True)

    @property
    def names(self) -> tuple[str, ...]:
        """Sorted; somebody with two links is in it twice."""
        with self._lock:
            return tuple(sorted(self._links.values()))

    def undeclare(self) -> None:
        """Stop listening; before the session is closed."""
        self._listener.undeclare()

    def _hear(self, event: zenoh.LinkEvent) -> None:
        link = event.link
        key = (str(link.zid), link.src, link.dst)
        name = link.auth_identifier or link.dst
        came = event.kind == zenoh.SampleKind.PUT
        with self._lock:
            if (key in self._links) == came:
                return
            if came:
                self._links[key] = name
            else:
                name = self._links.pop(key)
        self._changed(name, came)


def _settings(
    mode: str, listen: Sequence[str], connect: Sequence[str], keys: Path | None, certificate: str
) -> dict[str, Any]:
    link: dict[str, Any] = {
        "protocols": list(SECURE) if keys else ["tcp"],
        "tx": {"lease": LEASE_MS, "keep_alive": 4, "queue": _QUEUE},
        "rx": {"max_message_size": MAX_MESSAGE_BYTES},
    }
    if keys:
        check_certificate(keys, certificate)
        key, pem = str(keys / f"{certificate}.key"), str(keys / f"{certificate}.pem")
        link["tls"] = {
            "root_ca_certificate": str(keys / f"{CA}.pem"),
            "enable_mtls": True,
            "listen_private_key": key,
            "listen_certificate": pem,
            "connect_private_key": key,
            "connect_certificate": pem,
            "verify_name_on_connect": True,
            "close_link_on_expiration": True,
        }
    return {
        "mode": mode,
        "listen": {"endpoints": list(listen)},  # an empty list is none, not Zenoh's default
        "connect": {"endpoints": list(connect), "retry": _RETRY},
        "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "adminspace": {"enabled": False},
        "transport": {"link": link, "shared_memory": {"enabled": False}},
    }


def _access_control(keys: Path, certificate: str) -> dict[str, Any]:
    if not (keys / REGISTER).exists():
        raise BadConfig(
            f"there is no {keys / REGISTER}, which says who may do what: copy it from where the keys are made, "
            "whoever serves needs it besides the certificates"
        )
    register = read_register(keys)
    role = register.names.get(certificate)
    if role is None or not role.serves:
        known = ", ".join(sorted(name for name, held in register.names.items() if held.serves)) or "nobody"
        raise BadConfig(
            f"key 'service.certificate' = {certificate!r} is {role.value if role else 'nobody'} in {keys / REGISTER}: "
            f"rigs and engines may serve, that is {known}"
        )
    return access_control(register.names)


def _check_connect(connect: Sequence[str], key: str, secure: bool) -> None:
    for text in connect:
        if check_endpoint(text, key, secure).port == 0:
            raise BadConfig(f"key {key!r} = {text!r}: port 0 cannot be connected to: write the one that is listened on")


def _key_of(text: str, service: ServiceConfig) -> str:
    return "service.listen_images" if text in service.listen_images else "service.listen"


def _open(settings: dict[str, Any]) -> zenoh.Session:
    _prepare()
    return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))


@cache
def _prepare() -> None:
    """Zenoh says nothing unless RUST_LOG asks for it: what a user must know is in our errors. It has enough threads."""
    os.environ.setdefault("ZENOH_RUNTIME", THREADS)  # it is read once, before the first session
    zenoh.init_log_from_env_or("off")


def _resolved(host: str) -> list[str]:
    try:
        return [str(found[4][0]) for found in socket.getaddrinfo(host, None)]
    except OSError:
        return []
