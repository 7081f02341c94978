"""What somebody on another computer can reach. The other computer is a network namespace; making one takes root."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from ports import free_port
from processes import Serving, rig_of, serving, until
from served_rig import ServedRig

from viewsep.keys import KeyRole, init_keys, issue

RUN_S = 20.0
HERE, THERE = "198.18.77.1", "198.18.77.2"  # of the range for tests between networks, RFC 2544
PLUG = """
import socket, sys
with socket.create_connection((sys.argv[1], int(sys.argv[2])), timeout=3):
    print("connected")
"""
STRANGER = """
import sys
from pathlib import Path
from served_rig import rogue
rogue(sys.argv[1], Path(sys.argv[2]) if sys.argv[2] else None).close()
print("let in")
"""
OPERATOR = """
import sys
from pathlib import Path
from served_rig import answers
from viewsep.service.transport import client_session
session = client_session([sys.argv[1]], Path(sys.argv[2]), "op", 3.0)
print(answers(session, "viewsep/x/cmd/stop", b"{}"))
session.close()
"""


@dataclass(frozen=True)
class OtherComputer:
    """A network namespace with a cable to here."""

    name: str

    def run(self, program: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
        """Run Python there."""
        command = ["ip", "netns", "exec", self.name, sys.executable, "-c", program, *map(str, arguments)]
        env = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
        return subprocess.run(command, capture_output=True, text=True, timeout=RUN_S, env=env, check=False)


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True, timeout=RUN_S)


@pytest.fixture(scope="module")
def other() -> Iterator[OtherComputer]:
    if shutil.which("ip") is None:
        pytest.skip("there is no `ip` to make a network namespace with")
    name, cable = f"viewsep{os.getpid()}", f"vs{os.getpid()}"
    try:
        ip("netns", "add", name)
    except subprocess.CalledProcessError as error:
        pytest.skip(f"cannot make a network namespace: {error.stderr.strip()}")
    try:
        try:
            ip("link", "add", cable, "type", "veth", "peer", "name", "eth0", "netns", name)
            ip("address", "add", f"{HERE}/30", "dev", cable)
            ip("link", "set", cable, "up")
            ip("-n", name, "address", "add", f"{THERE}/30", "dev", "eth0")
            ip("-n", name, "link", "set", "eth0", "up")
        except subprocess.CalledProcessError as error:
            pytest.skip(f"cannot lay a cable to the network namespace: {error.stderr.strip()}")
        yield OtherComputer(name)
    finally:
        with suppress(subprocess.CalledProcessError):
            ip("link", "delete", cable)
        ip("netns", "delete", name)


def test_without_keys_nobody_outside_reaches_the_rig(other: OtherComputer) -> None:
    rig = ServedRig(None, f"tcp/127.0.0.1:{free_port()}")
    refused = other.run(PLUG, HERE, rig.endpoint.rsplit(":", 1)[1])
    assert "ConnectionRefusedError" in refused.stderr
    assert (rig.links, rig.saw) == ([], [])
    rig.close()


def test_a_service_with_default_settings_is_not_reached_from_outside(
    other: OtherComputer, settings: Mapping[str, Any], tmp_path: Path
) -> None:
    service = Serving(tmp_path, settings)
    with serving(service), service.client() as client:
        until(lambda: rig_of(client).connections, 10, "the client's own connection is not listed")
        before = rig_of(client)
        for port in (service.port, service.image_port):
            assert "ConnectionRefusedError" in other.run(PLUG, HERE, str(port)).stderr
        assert "Unable to connect" in other.run(STRANGER, f"tcp/{HERE}:{service.port}", "").stderr
        after = rig_of(client)
    assert after.connections == before.connections
    assert all(who.startswith("tcp/127.0.0.1:") for who in after.connections)
    assert (after.motion.joints, after.motion.holder) == (before.motion.joints, "")
    assert HERE not in service.log
    assert THERE not in service.log


def test_with_keys_a_stranger_outside_is_not_let_in_and_an_operator_is(other: OtherComputer, tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    init_keys(keys)
    issue(keys, "rig", KeyRole.RIG, [HERE])
    issue(keys, "op", KeyRole.OPERATOR)
    rig = ServedRig(keys, f"tls/{HERE}:{free_port()}")
    address = rig.endpoint.removeprefix("tls/")
    assert other.run(PLUG, HERE, address.rsplit(":", 1)[1]).stdout == "connected\n"  # the cable is there
    for endpoint, authority in ((rig.endpoint, keys / "ca.pem"), (f"tcp/{address}", "")):
        stranger = other.run(STRANGER, endpoint, authority)
        assert "Unable to connect" in stranger.stderr
    assert (rig.links, rig.saw) == ([], [])
    operator = other.run(OPERATOR, rig.endpoint, keys)
    assert operator.stdout == "['the rig']\n", operator.stderr
    assert rig.links[0] == ("op", True)
    assert rig.saw == [("query", "viewsep/x/cmd/stop", 2)]
    rig.close()
