"""A served rig that remembers what reaches it, keys for those who may and may not, and sessions that obey no rule."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import zenoh
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from viewsep.config import ServiceConfig
from viewsep.keys import KeyRole, init_keys, issue, revoke
from viewsep.service.transport import Connections, serving_session

WAIT_S = 10.0
ASK: dict[str, Any] = {"target": zenoh.QueryTarget.ALL, "consolidation": zenoh.ConsolidationMode.NONE}


def until(condition: Callable[[], object], what: str) -> None:
    """Wait until the condition holds."""
    deadline = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline, f"never: {what}"
        time.sleep(0.005)


def end(*things: Any) -> None:
    """Undeclare or close each, in order. Zenoh does not type these methods."""
    for thing in things:
        thing.close() if isinstance(thing, zenoh.Session) else thing.undeclare()


def make_keys(folder: Path) -> Path:
    """Keys of rig, engine, op, view; of `gone`, who was revoked; of `late`, which expired yesterday."""
    init_keys(folder)
    for name, role in {
        "rig": "rig",
        "engine": "engine",
        "op": "operator",
        "view": "viewer",
        "gone": "operator",
    }.items():
        issue(folder, name, KeyRole(role))
    revoke(folder, "gone")
    issue(folder, "late", KeyRole.OPERATOR)
    sign_again(folder, "late", -1)
    return folder


def sign_again(folder: Path, name: str, days: float) -> None:
    """Have the CA sign the certificate of `name` once more, good until so many days from now."""
    ca_key = serialization.load_pem_private_key((folder / "ca.key").read_bytes(), None)
    old = x509.load_pem_x509_certificate((folder / f"{name}.pem").read_bytes())
    builder = x509.CertificateBuilder(old.issuer, old.subject, old.public_key(), old.serial_number)
    now = datetime.now(UTC)
    builder = builder.not_valid_before(now - timedelta(days=2)).not_valid_after(now + timedelta(days=days))
    for extension in old.extensions:
        builder = builder.add_extension(extension.value, extension.critical)
    assert isinstance(ca_key, ec.EllipticCurvePrivateKey)
    new = builder.sign(ca_key, hashes.SHA256())
    (folder / f"{name}.pem").write_bytes(new.public_bytes(serialization.Encoding.PEM))


def common_name(certificate: Path) -> str:
    subject = x509.load_pem_x509_certificate(certificate.read_bytes()).subject
    return str(subject.get_attributes_for_oid(NameOID.COMMON_NAME)[0].value)


def rogue(
    endpoint: str,
    authority: Path | None = None,
    certificate: Path | None = None,
    mode: str = "client",
    listen: Sequence[str] = (),
) -> zenoh.Session:
    """A session that checks nothing on its own side. Raises ZError when it is not let in."""
    tls: dict[str, Any] = {}
    if authority:
        tls["root_ca_certificate"] = str(authority)
    if certificate:
        pem, key = str(certificate), str(certificate.with_suffix(".key"))
        tls |= {"enable_mtls": True, "connect_certificate": pem, "connect_private_key": key}
        tls |= {"listen_certificate": pem, "listen_private_key": key}
    settings = {
        "mode": mode,
        "listen": {"endpoints": list(listen)},
        "connect": {"endpoints": [endpoint] if endpoint else [], "timeout_ms": 300, "exit_on_failure": True},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"link": {"tls": tls}},
    }
    return zenoh.open(zenoh.Config.from_json5(json.dumps(settings)))


class ServedRig:
    """Rig `x` on one endpoint: answers everything, publishes on demand, and notes what reaches it in `saw`."""

    def __init__(self, keys: Path | None, endpoint: str) -> None:
        self.endpoint = endpoint
        self.saw: list[tuple[str, str, int]] = []  # what, key, bytes
        self.links: list[tuple[str, bool]] = []
        service = ServiceConfig(keys=str(keys or ""), listen=(endpoint,))
        self.session = session = serving_session(service, service.listen, ())
        self.connections = Connections(session, lambda name, came: self.links.append((name, came)))
        self._declared: list[Any] = [
            session.declare_queryable("viewsep/x/status", self._answer),
            session.declare_queryable("viewsep/x/manifest", self._answer),
            session.declare_queryable("viewsep/x/cmd/*", self._answer),
            session.declare_queryable("viewsep/x/rig/*", self._answer),
            session.declare_subscriber("viewsep/**", self._sample),
            session.liveliness().declare_subscriber("viewsep/**", lambda token: self._note("token", token.key_expr, 0)),
            session.liveliness().declare_token("viewsep/x/alive/rig"),
        ]
        until(lambda: ("token", "viewsep/x/alive/rig", 0) in self.saw, "the rig hears its own token")
        self.saw.clear()

    def _note(self, what: str, key: object, size: int) -> None:
        self.saw.append((what, str(key), size))

    def _sample(self, sample: zenoh.Sample) -> None:
        self._note(str(sample.kind).rsplit(".", 1)[-1].lower(), sample.key_expr, len(sample.payload.to_bytes()))

    def _answer(self, query: zenoh.Query) -> None:
        self._note("query", query.key_expr, len(query.payload.to_bytes()) if query.payload else 0)
        query.reply(query.key_expr, "the rig")

    def asked(self, key: str) -> list[str]:
        """What this session hears when it asks."""
        return answers(self.session, key)

    def after(self, session: zenoh.Session, name: str) -> list[tuple[str, str, int]]:
        """Close the session of `name`, and all that had reached the rig by the time its link was gone."""
        end(session)
        until(lambda: name not in self.connections.names, f"{name} goes")
        return list(self.saw)

    def close(self) -> None:
        end(*self._declared, self.connections, self.session)


def answers(session: zenoh.Session, key: str, payload: bytes | None = None, timeout: float = 2.0) -> list[str]:
    """The replies to a query, sorted."""
    replies = session.get(key, payload=payload, timeout=timeout, **ASK)
    return sorted(reply.ok.payload.to_string() for reply in replies if reply.ok)
