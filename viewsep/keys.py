"""Keys of the service: a private certificate authority (CA), certificates for those who connect, and their register.

A folder holds `ca.pem`, `ca.key`, `register.json`, and `NAME.pem` with `NAME.key` for every name issued. Another
computer needs `ca.pem`, `NAME.pem` and `NAME.key` only, one that serves also `register.json`; `ca.key` stays.
The certificates say who somebody is (the common name), the register says what that name may do.
"""

from __future__ import annotations

import json
import os
import re
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from ipaddress import ip_address
from pathlib import Path
from typing import Annotated, Literal

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from viewsep.errors import BadConfig, BadInput

SCHEMA = "viewsep.keys/1"
CA, REGISTER = "ca", "register.json"
DAYS, CA_DAYS = 365, 3653
NAME_PATTERN = r"^[A-Za-z0-9_.-]{1,64}$"
_LABEL = r"(?!-)[A-Za-z0-9-]{1,63}(?<!-)"
_DNS_NAME = re.compile(rf"(?=.{{1,253}}$){_LABEL}(\.{_LABEL})*$")
_CLOCKS_DIFFER = timedelta(hours=1)  # a new certificate is good at once on a computer whose clock is behind


class KeyRole(StrEnum):
    """What the holder of a certificate may do."""

    RIG = "rig"  # serves the rig
    ENGINE = "engine"  # serves the engine
    OPERATOR = "operator"  # sees everything and commands
    VIEWER = "viewer"  # sees everything

    @property
    def serves(self) -> bool:
        """Whether others may connect to its holder and believe what it says."""
        return self in (KeyRole.RIG, KeyRole.ENGINE)


Name = Annotated[str, Field(pattern=NAME_PATTERN)]


class Register(BaseModel):
    """Who may do what: `names` with their roles. A name in `revoked` is never issued again: its old key would count."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    schema_: Literal["viewsep.keys/1"] = Field(default="viewsep.keys/1", alias="schema")
    names: dict[Name, KeyRole] = {}
    revoked: tuple[Name, ...] = ()

    @model_validator(mode="after")
    def _one_or_the_other(self) -> Register:
        if both := sorted(set(self.names) & set(self.revoked)):
            raise ValueError(f"{both[0]!r} is in names and in revoked: remove one")
        return self

    def to_json(self) -> bytes:
        """As it is kept."""
        return self.model_dump_json(by_alias=True, indent=2).encode() + b"\n"


@dataclass(frozen=True, slots=True)
class KeyEntry:
    """One name of the register; `expires` is None where its certificate is not in the folder."""

    name: str
    role: KeyRole
    expires: datetime | None


def init_keys(folder: Path) -> None:
    """Make the CA and an empty register. Raises BadInput when there is something already, or others may look in."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        mode = folder.stat().st_mode
    except OSError as error:
        raise BadInput(f"cannot make the key folder {folder}: {error.strerror}; choose another place") from error
    for name in (f"{CA}.key", f"{CA}.pem", REGISTER):
        if (folder / name).exists():
            raise BadInput(
                f"{folder / name} exists: issue certificates with `viewsep keys issue`, or choose a new folder"
            )
    if mode & 0o077:
        raise BadInput(f"others may look into the key folder {folder}: run `chmod 700 {folder}` first")
    key = ec.generate_private_key(ec.SECP256R1())
    itself = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "viewsep CA")])
    usage = dict.fromkeys(
        ("key_encipherment", "data_encipherment", "key_agreement", "content_commitment", "encipher_only"), False
    )
    certificate = (
        _certificate(itself, itself, key.public_key(), CA_DAYS)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(
            x509.KeyUsage(digital_signature=True, key_cert_sign=True, crl_sign=True, decipher_only=False, **usage),
            critical=True,
        )
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, hashes.SHA256())
    )
    _write(folder / f"{CA}.key", _key_pem(key))
    _write(folder / f"{CA}.pem", certificate.public_bytes(serialization.Encoding.PEM))
    _write(folder / REGISTER, Register().to_json())


def issue(
    folder: Path, name: str, role: KeyRole, hosts: Sequence[str] = (), days: int = DAYS, *, renew: bool = False
) -> None:
    """Make a key and a certificate for `name` and enter it into the register with `role`.

    `hosts` are the DNS names and IP addresses, besides this computer's own, under which a rig or an engine is reached.
    `renew` replaces what `name` has; the old key counts until it expires. Raises BadInput, BadConfig.
    """
    check_name(name)
    if name.lower() == CA:
        raise BadInput(f"{name!r} is the certificate authority's: choose another name")
    if hosts and not role.serves:
        raise BadInput(
            f"--host {hosts[0]} goes with --role rig or engine, nobody connects to a {role.value}: leave it out"
        )
    alternatives = [x509.DNSName("localhost"), *(_host(host) for host in ("127.0.0.1", "::1", *hosts))]
    with _locked(folder):
        register = read_register(folder)
        authority, ca_key = _authority(folder)
        if name in register.revoked:
            raise BadInput(f"{name!r} was revoked, and the old key would count again: choose another name")
        if not renew:
            for taken in (folder / f"{name}.key", folder / f"{name}.pem"):
                if taken.exists():
                    raise BadInput(f"{taken} exists: issue {name!r} anew with --renew, or choose another name")
            if name in register.names:
                raise BadInput(
                    f"{name!r} is in {folder / REGISTER}: issue it anew with --renew, or choose another name"
                )
        last = authority.not_valid_after_utc
        if not 1 <= days <= CA_DAYS or datetime.now(UTC) + timedelta(days=days) > last:
            raise BadInput(f"--days {days}: use 1 or more, and not beyond {last:%Y-%m-%d}, when {CA}.pem expires")
        key = ec.generate_private_key(ec.SECP256R1())
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        uses = [ExtendedKeyUsageOID.CLIENT_AUTH]
        if role.serves:  # an operator's or a viewer's certificate cannot pose as a rig
            uses.append(ExtendedKeyUsageOID.SERVER_AUTH)
        certificate = (
            _certificate(subject, authority.subject, key.public_key(), days)
            .add_extension(x509.SubjectAlternativeName(alternatives), critical=False)
            .add_extension(x509.ExtendedKeyUsage(uses), critical=False)
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(ca_key.public_key()), critical=False)
            .sign(ca_key, hashes.SHA256())
        )
        _write(folder / f"{name}.key", _key_pem(key), replace=renew)
        _write(folder / f"{name}.pem", certificate.public_bytes(serialization.Encoding.PEM), replace=renew)
        entered = register.model_copy(update={"names": {**register.names, name: role}})
        _write(folder / REGISTER, entered.to_json(), replace=True)


def revoke(folder: Path, name: str) -> None:
    """Take `name` out of the register, for good. Raises BadInput when it is not there, BadConfig for a bad register."""
    check_name(name)
    with _locked(folder):
        register = read_register(folder)
        if name not in register.names:
            known = ", ".join(sorted(register.names)) or "nobody"
            raise BadInput(f"{name!r} is not in {folder / REGISTER}: there are {known}")
        names = {known: role for known, role in register.names.items() if known != name}
        changed = register.model_copy(update={"names": names, "revoked": (*register.revoked, name)})
        _write(folder / REGISTER, changed.to_json(), replace=True)


def read_register(folder: Path) -> Register:
    """The register of a key folder. Raises BadConfig when there is none, or it is damaged."""
    path = folder / REGISTER
    try:
        table = json.loads(path.read_bytes(), object_pairs_hook=_unique)
        return Register.model_validate(table)
    except FileNotFoundError:
        raise BadConfig(f"there is no {path}: make the keys with `viewsep keys init {folder}`") from None
    except OSError as error:
        raise BadConfig(f"cannot read {path}: {error.strerror}; make it readable for whoever runs viewsep") from error
    except ValidationError as error:
        first = error.errors()[0]
        at = ".".join(str(part) for part in first["loc"]) or "it"
        raise BadConfig(f"{path}: {at}: {first['msg'][0].lower()}{first['msg'][1:]}; restore it from a copy") from error
    except (ValueError, RecursionError) as error:
        raise BadConfig(f"{path} is no register: {error}; restore it from a copy") from error


def describe(folder: Path) -> tuple[KeyEntry, ...]:
    """All names of the register in order, with their roles and expiries. Raises BadConfig."""
    entries = []
    for name, role in sorted(read_register(folder).names.items()):
        path = folder / f"{name}.pem"
        entries.append(KeyEntry(name, role, _read_certificate(path).not_valid_after_utc if path.exists() else None))
    return tuple(entries)


def check_certificate(folder: Path, name: str) -> None:
    """Check that `name` can connect with what the folder holds: its key, its certificate, the CA's.

    Raises BadConfig when a file is missing, damaged, expired or open to others, or when they do not go together.
    """
    check_name(name)
    key_path, path, ca_path = folder / f"{name}.key", folder / f"{name}.pem", folder / f"{CA}.pem"
    for needed in (key_path, path, ca_path):
        if not needed.is_file():
            raise BadConfig(
                f"there is no {needed}: copy {CA}.pem, {name}.pem and {name}.key from where the keys are made"
            )
    for secret in (key_path, folder / f"{CA}.key"):
        if secret.exists() and secret.stat().st_mode & 0o077:
            raise BadConfig(f"others may read {secret}: run `chmod 600 {secret}`")
    for trusted in (ca_path, folder / REGISTER):
        if trusted.exists() and trusted.stat().st_mode & 0o022:
            raise BadConfig(f"others may change {trusted}: run `chmod 600 {trusted}`")
    certificate, authority = _read_certificate(path), _read_certificate(ca_path)
    if _read_key(key_path).public_key() != certificate.public_key():
        raise BadConfig(f"{key_path} and {path} do not go together: copy both again")
    try:
        certificate.verify_directly_issued_by(authority)
    except Exception as error:  # one of three kinds, which say the same to a user
        raise BadConfig(f"{path} was not issued by {ca_path}: copy both from the same folder") from error
    common = [str(attribute.value) for attribute in certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)]
    if common != [name]:
        raise BadConfig(f"{path} is the certificate of {', '.join(common) or 'nobody'}: name the file after its holder")
    for checked in (path, ca_path):
        last = _read_certificate(checked).not_valid_after_utc
        if last <= datetime.now(UTC):
            raise BadConfig(f"{checked} expired on {last:%Y-%m-%d}: issue it anew with `viewsep keys issue --renew`")


def check_name(name: str) -> None:
    """Raises BadInput when `name` cannot be a certificate's."""
    if not re.match(NAME_PATTERN, name) or name.endswith("\n"):
        raise BadInput(f"{name!r} cannot be the name of a certificate: use 1 to 64 letters, digits, '_', '.' and '-'")


def is_dns_name(host: str) -> bool:
    """Whether `host` is a DNS name; one that ends in a number is taken for a badly written address."""
    return bool(_DNS_NAME.match(host)) and not host.rsplit(".", 1)[-1].isdigit()


def _host(host: str) -> x509.GeneralName:
    with suppress(ValueError):
        if "%" not in host:
            return x509.IPAddress(ip_address(host))
    if not is_dns_name(host):
        raise BadInput(f"--host {host!r} is no DNS name and no IP address: write rig.example.org or 192.0.2.7")
    return x509.DNSName(host)


def _certificate(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, days: int
) -> x509.CertificateBuilder:
    now = datetime.now(UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _CLOCKS_DIFFER)
        .not_valid_after(now + timedelta(days=days))
    )


def _key_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def _authority(folder: Path) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    path = folder / f"{CA}.key"
    if not path.exists():
        raise BadConfig(f"there is no {path}: certificates are issued where `viewsep keys init` was run")
    certificate, key = _read_certificate(folder / f"{CA}.pem"), _read_key(path)
    if key.public_key() != certificate.public_key():
        raise BadConfig(f"{path} and {CA}.pem do not go together: restore both from a copy")
    return certificate, key


def _read_certificate(path: Path) -> x509.Certificate:
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except (OSError, ValueError) as error:
        raise BadConfig(f"{path} cannot be read as a certificate: restore it from a copy, or issue it anew") from error


def _read_key(path: Path) -> ec.EllipticCurvePrivateKey:
    try:
        key = serialization.load_pem_private_key(path.read_bytes(), password=None)
    except (OSError, ValueError, TypeError) as error:
        raise BadConfig(f"{path} cannot be read as a key: restore it from a copy, or issue it anew") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise BadConfig(f"{path} is no elliptic-curve key: restore it from a copy, or issue it anew")
    return key


def _unique(pairs: list[tuple[str, object]]) -> dict[str, object]:
    table = dict(pairs)
    if len(table) != len(pairs):
        raise ValueError("a name is in it twice")
    return table


def _write(path: Path, data: bytes, *, replace: bool = False) -> None:
    """Write under a temporary name that only the owner can read, then rename; an old file stays unless `replace`."""
    partial = ""
    try:
        descriptor, partial = tempfile.mkstemp(dir=path.parent, prefix=".", suffix=".part")  # mode 0600 from the start
        with os.fdopen(descriptor, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(descriptor)
        if replace:
            Path(partial).replace(path)
        else:
            path.hardlink_to(partial)  # unlike a rename, this never overwrites
    except FileExistsError:
        raise BadInput(f"{path} exists: it was not changed") from None
    except OSError as error:
        raise BadInput(f"cannot write {path}: {error.strerror}; choose another place") from error
    finally:
        with suppress(OSError):
            Path(partial).unlink()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Keep other commands from changing the register meanwhile."""
    import fcntl  # keys are made on POSIX systems; the rest of viewsep does not need it

    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise BadConfig(f"there is no key folder {folder}: make it with `viewsep keys init {folder}`") from error
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)
