"""`viewsep keys`, as if typed."""

from __future__ import annotations

import json
import stat
from pathlib import Path

import pytest
from shell import Shell


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path / "keys"


def test_init_issue_revoke_list(shell: Shell, folder: Path) -> None:
    assert shell("keys", "init").err == "made keys; next: viewsep keys issue rig --role rig\n"
    rig = shell("keys", "issue", "rig", "--role", "rig", "--host", "rig.example.org", "--host", "192.0.2.7")
    assert "it needs ca.pem, rig.pem, rig.key, register.json from keys" in rig.err
    ann = shell("keys", "issue", "ann", "--role", "operator", "--days", 30)
    assert "issued ann, operator, for 30 days; it needs ca.pem, ann.pem, ann.key from keys" in ann.err
    listed = shell("keys", "list", "--json").json
    assert [(entry["name"], entry["role"]) for entry in listed] == [("ann", "operator"), ("rig", "rig")]
    assert listed[0]["expires"] < listed[1]["expires"]
    assert "copy keys/register.json to all services and restart them" in shell("keys", "revoke", "ann").err
    (folder / "rig.pem").unlink()
    table = shell("keys", "list")
    assert table.code == 0
    assert "certificate not here" in table.out
    assert "ann" not in table.out
    assert stat.S_IMODE((folder / "rig.key").stat().st_mode) == 0o600
    assert json.loads((folder / "register.json").read_text())["revoked"] == ["ann"]


@pytest.mark.parametrize(
    ("typed", "words"),
    [
        ("init", "viewsep: keys/ca.key exists: issue certificates with"),
        ("issue ann --role viewer", "viewsep: keys/ann.key exists: issue 'ann' anew with --renew, or"),
        ("issue a/b --role viewer", "viewsep: 'a/b' cannot be the name of a certificate: use 1 to 64"),
        ("issue bob --role viewer --days 0", "viewsep: --days 0: use 1 or more"),
        ("issue bob --role viewer --host x", "viewsep: --host x goes with --role rig or engine"),
        ("issue bob --role viewer --keys nowhere", "viewsep: there is no key folder nowhere: make it with `viewsep"),
        ("revoke bob", "viewsep: 'bob' is not in keys/register.json: there are ann"),
        ("list --keys nowhere", "viewsep: there is no nowhere/register.json: make the keys with `viewsep keys init"),
    ],
)
def test_bad_input_ends_in_one_sentence(shell: Shell, folder: Path, typed: str, words: str) -> None:
    shell("keys", "init")
    shell("keys", "issue", "ann", "--role", "viewer")
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    ended = shell("keys", *typed.split())
    assert (ended.code, ended.out) == (2, "")
    assert ended.err.startswith(words)
    assert len(ended.err.splitlines()) == 1
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_an_unknown_role_shows_the_usage(shell: Shell) -> None:
    ended = shell("keys", "issue", "ann", "--role", "boss")
    assert (ended.code, ended.out) == (2, "")
    assert "Usage: viewsep keys issue" in ended.err
