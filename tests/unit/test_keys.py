"""The private CA: who can read what, what is never overwritten, and what a damaged folder ends in."""

from __future__ import annotations

import json
import os
import shutil
import threading
from collections.abc import Callable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.x509.oid import ExtendedKeyUsageOID
from hypothesis import given
from hypothesis import strategies as st
from served_rig import common_name, make_keys, sign_again

from viewsep.errors import BadConfig, BadInput
from viewsep.keys import (
    NAME_PATTERN,
    KeyRole,
    Register,
    check_certificate,
    check_name,
    describe,
    init_keys,
    issue,
    read_register,
    revoke,
)

names = st.from_regex(NAME_PATTERN, fullmatch=True).filter(lambda name: not name.endswith("\n"))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_keys(tmp_path_factory.mktemp("made") / "keys")


@pytest.fixture
def keys(made: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(made, tmp_path / "keys"))


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """For registers alone."""
    return tmp_path_factory.mktemp("shelf")


@pytest.fixture
def careless() -> Iterator[None]:
    """A umask that keeps nothing from anybody."""
    old = os.umask(0)
    yield
    os.umask(old)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


@pytest.mark.usefixtures("careless")
def test_only_the_owner_can_look_in_whatever_the_umask(tmp_path: Path) -> None:
    folder = make_keys(tmp_path / "keys")
    assert folder.stat().st_mode & 0o777 == 0o700
    modes = {path.name: path.stat().st_mode & 0o777 for path in folder.iterdir()}
    assert set(modes) >= {"ca.pem", "ca.key", "register.json", "rig.pem", "rig.key"}
    assert set(modes.values()) == {0o600}, modes


@pytest.mark.usefixtures("careless")
def test_no_file_is_ever_open_or_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "keys"
    init_keys(folder)
    seen: list[tuple[str, int]] = []
    flush = os.fsync

    def watch(descriptor: int) -> None:
        flush(descriptor)
        seen.extend((path.name, path.stat().st_mode & 0o777) for path in folder.iterdir())

    monkeypatch.setattr(os, "fsync", watch)
    issue(folder, "ann", KeyRole.VIEWER)
    assert {mode for _, mode in seen} == {0o600}
    assert not [path for path in folder.iterdir() if path.suffix == ".part"]
    order = [name for name, _ in seen if name.startswith("ann.")]
    assert order.index("ann.key") < order.index("ann.pem")


def test_whoever_is_interrupted_issues_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "keys"
    init_keys(folder)

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        with pytest.raises(BadInput, match=r"cannot write .*ann\.key: No space left on device"):
            issue(folder, "ann", KeyRole.VIEWER)
    assert set(contents(folder)) == {"ca.pem", "ca.key", "register.json"}
    (folder / "ann.key").write_text("left over")
    with pytest.raises(BadInput, match=r"ann\.key exists: issue 'ann' anew with --renew"):
        issue(folder, "ann", KeyRole.VIEWER)
    (folder / "ann.key").chmod(0o600)
    issue(folder, "ann", KeyRole.VIEWER, renew=True)
    check_certificate(folder, "ann")


@pytest.mark.parametrize("role", KeyRole)
def test_a_certificate_says_who_it_is_and_what_it_is_for(tmp_path: Path, role: KeyRole) -> None:
    folder = tmp_path / "keys"
    init_keys(folder)
    hosts = ("rig.example.org", "192.0.2.7", "2001:db8::7") if role.serves else ()
    issue(folder, "ann", role, hosts, days=30)
    check_certificate(folder, "ann")
    certificate = x509.load_pem_x509_certificate((folder / "ann.pem").read_bytes())
    authority = x509.load_pem_x509_certificate((folder / "ca.pem").read_bytes())
    certificate.verify_directly_issued_by(authority)
    assert common_name(folder / "ann.pem") == "ann"
    uses = set(certificate.extensions.get_extension_for_class(x509.ExtendedKeyUsage).value)
    assert ExtendedKeyUsageOID.CLIENT_AUTH in uses
    assert (ExtendedKeyUsageOID.SERVER_AUTH in uses) == role.serves
    alternatives = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert set(alternatives.get_values_for_type(x509.DNSName)) == {"localhost", *hosts[:1]}
    assert {str(ip) for ip in alternatives.get_values_for_type(x509.IPAddress)} == {"127.0.0.1", "::1", *hosts[1:]}
    left = certificate.not_valid_after_utc - datetime.now(UTC)
    assert timedelta(days=29, hours=23) < left <= timedelta(days=30)
    assert not certificate.extensions.get_extension_for_class(x509.BasicConstraints).value.ca
    assert authority.not_valid_after_utc - datetime.now(UTC) > timedelta(days=3650)
    assert read_register(folder).names == {"ann": role}


def test_the_register_and_its_description(keys: Path) -> None:
    register = read_register(keys)
    expected = {"rig": "rig", "engine": "engine", "op": "operator", "view": "viewer", "late": "operator"}
    assert register.names == expected
    assert register.revoked == ("gone",)
    (keys / "op.pem").unlink()
    entries = {entry.name: entry for entry in describe(keys)}
    assert {name: entry.role for name, entry in entries.items()} == expected
    assert list(entries) == sorted(entries)
    assert entries["op"].expires is None
    late, rig = entries["late"].expires, entries["rig"].expires
    assert late is not None
    assert rig is not None
    assert late < datetime.now(UTC) < rig


def test_renewing_gives_another_key_and_role(keys: Path) -> None:
    before = contents(keys)
    issue(keys, "op", KeyRole.VIEWER, renew=True)
    after = contents(keys)
    assert {name for name in before if before[name] != after[name]} == {"op.pem", "op.key", "register.json"}
    assert read_register(keys).names["op"] is KeyRole.VIEWER
    check_certificate(keys, "op")


def test_names_issued_at_the_same_time_are_all_entered(keys: Path) -> None:
    threads = [threading.Thread(target=issue, args=(keys, f"viewer{number}", KeyRole.VIEWER)) for number in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert {f"viewer{number}" for number in range(6)} <= set(read_register(keys).names)


REFUSED: dict[str, tuple[Callable[[Path], object], str]] = {
    "init twice": (init_keys, "ca.key exists: issue certificates with"),
    "issue twice": (lambda keys: issue(keys, "op", KeyRole.OPERATOR), "op.key exists: issue 'op' anew with --renew"),
    "issue after revoke": (lambda keys: issue(keys, "gone", KeyRole.VIEWER), "'gone' was revoked, and the old key"),
    "renew after revoke": (
        lambda keys: issue(keys, "gone", KeyRole.VIEWER, renew=True),
        "'gone' was revoked, and the old key would count again: choose another name",
    ),
    "revoke twice": (lambda keys: revoke(keys, "gone"), "'gone' is not in .*register.json: there are engine, late"),
    "name of the CA": (lambda keys: issue(keys, "CA", KeyRole.VIEWER, renew=True), "'CA' is the certificate authority"),
    "bad name": (lambda keys: issue(keys, "../op", KeyRole.VIEWER), r"'../op' cannot be the name"),
    "wildcard name": (lambda keys: issue(keys, "*", KeyRole.VIEWER), r"'\*' cannot be the name"),
    "no days": (lambda keys: issue(keys, "ann", KeyRole.VIEWER, days=0), "--days 0: use 1 or more"),
    "beyond the CA": (lambda keys: issue(keys, "ann", KeyRole.VIEWER, days=3654), "--days 3654: .*when ca.pem expires"),
    "endless": (lambda keys: issue(keys, "ann", KeyRole.VIEWER, days=10**12), "--days 1000000000000: use 1"),
    "host of a viewer": (lambda keys: issue(keys, "ann", KeyRole.VIEWER, ["a.b"]), "--host a.b goes with --role rig"),
    "bad host": (lambda keys: issue(keys, "ann", KeyRole.RIG, ["a b"]), "--host 'a b' is no DNS name and no IP"),
    "wildcard host": (lambda keys: issue(keys, "ann", KeyRole.RIG, ["*.b"]), r"--host '\*.b' is no DNS name"),
    "half an address": (lambda keys: issue(keys, "ann", KeyRole.RIG, ["127.1"]), "--host '127.1' is no DNS name"),
    "scoped address": (lambda keys: issue(keys, "ann", KeyRole.RIG, ["fe80::1%eth0"]), "--host 'fe80::1%eth0' is no"),
}


@pytest.mark.parametrize(("act", "words"), REFUSED.values(), ids=REFUSED)
def test_what_is_refused_changes_nothing(keys: Path, act: Callable[[Path], object], words: str) -> None:
    before = contents(keys)
    with pytest.raises(BadInput, match=words):
        act(keys)
    assert contents(keys) == before


def test_a_folder_for_keys_is_nobody_elses(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    with pytest.raises(BadInput, match=f"others may look into the key folder {tmp_path}: run `chmod 700 "):
        init_keys(tmp_path)
    assert contents(tmp_path) == {}
    (tmp_path / "file").touch()
    with pytest.raises(BadInput, match=r"cannot make the key folder .*file"):
        init_keys(tmp_path / "file")


def changed(name: str, content: bytes) -> Callable[[Path], object]:
    return lambda keys: (keys / name).write_bytes(content)


def copied(source: str, target: str) -> Callable[[Path], object]:
    return lambda keys: shutil.copy(keys / source, keys / target)


def foreign(keys: Path) -> None:
    init_keys(keys / "other")
    shutil.copy(keys / "other" / "ca.pem", keys / "ca.pem")


UNUSABLE: dict[str, tuple[Callable[[Path], object], str]] = {
    "no key": (lambda keys: (keys / "op.key").unlink(), "there is no .*op.key: copy ca.pem, op.pem and op.key"),
    "no CA": (lambda keys: (keys / "ca.pem").unlink(), "there is no .*ca.pem: copy"),
    "key for all to see": (lambda keys: (keys / "op.key").chmod(0o604), "others may read .*op.key: run `chmod 600"),
    "CA's key for all": (lambda keys: (keys / "ca.key").chmod(0o640), "others may read .*ca.key: run `chmod 600"),
    "register for all": (lambda keys: (keys / "register.json").chmod(0o662), "others may change .*register.json: run"),
    "damaged certificate": (changed("op.pem", b"x"), "op.pem cannot be read as a certificate"),
    "damaged key": (changed("op.key", b"x"), "op.key cannot be read as a key"),
    "another's key": (copied("view.key", "op.key"), "op.key and .*op.pem do not go together"),
    "another CA": (foreign, "op.pem was not issued by .*ca.pem"),
    "renamed": (
        lambda keys: [copied("view.key", "op.key")(keys), copied("view.pem", "op.pem")(keys)],
        "op.pem is the certificate of view: name the file after its holder",
    ),
    "expired": (lambda keys: sign_again(keys, "op", -1), r"op.pem expired on \d{4}-.*viewsep keys issue --renew"),
}


@pytest.mark.parametrize(("spoil", "words"), UNUSABLE.values(), ids=UNUSABLE)
def test_keys_that_cannot_be_used_are_named(keys: Path, spoil: Callable[[Path], object], words: str) -> None:
    check_certificate(keys, "op")
    spoil(keys)
    with pytest.raises(BadConfig, match=words):
        check_certificate(keys, "op")


REGISTERS = {
    "empty": ("", "is no register"),
    "no object": ("[]", "register.json: it: "),
    "another schema": ('{"schema": "viewsep.keys/2", "names": {}}', "register.json: schema: "),
    "unknown field": ('{"schema": "viewsep.keys/1", "x": 1}', "register.json: x: extra"),
    "unknown role": ('{"schema": "viewsep.keys/1", "names": {"a": "root"}}', "register.json: names.a: "),
    "bad name": ('{"schema": "viewsep.keys/1", "names": {"a/*": "rig"}}', "register.json: names"),
    "name twice": ('{"schema": "viewsep.keys/1", "names": {"a": "viewer", "a": "rig"}}', "a name is in it twice"),
    "both": ('{"schema": "viewsep.keys/1", "names": {"a": "rig"}, "revoked": ["a"]}', "'a' is in names and in revoked"),
    "too deep": ("[" * 100000, "is no register"),
    "not text": ("\udcff", "is no register"),
}


@pytest.mark.parametrize(("text", "words"), REGISTERS.values(), ids=REGISTERS)
def test_a_damaged_register_gives_nobody_anything(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "register.json").write_bytes(text.encode(errors="surrogateescape"))
    with pytest.raises(BadConfig, match=words):
        read_register(tmp_path)


@given(held=st.dictionaries(names, st.sampled_from(KeyRole), max_size=8), more=st.lists(names, max_size=4))
def test_a_register_is_read_as_it_was_written(shelf: Path, held: dict[str, KeyRole], more: list[str]) -> None:
    register = Register(names=held, revoked=tuple(name for name in more if name not in held))
    (shelf / "register.json").write_bytes(register.to_json())
    assert read_register(shelf) == register
    assert json.loads(register.to_json())["schema"] == "viewsep.keys/1"


@given(st.text(max_size=70))
def test_a_name_is_one_plain_word(name: str) -> None:
    plain = 0 < len(name) <= 64 and all(sign.isascii() and (sign.isalnum() or sign in "_.-") for sign in name)
    if plain:
        check_name(name)
    else:
        with pytest.raises(BadInput, match="cannot be the name of a certificate"):
            check_name(name)
