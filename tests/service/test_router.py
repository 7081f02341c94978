"""A router between clients and two rigs: its endpoint alone leads to both."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from processes import Serving, serving, until
from served_rig import make_keys

from viewsep.client import Client, rigs


@pytest.mark.parametrize("secure", [False, True], ids=["loopback", "keys"])
def test_who_knows_the_router_reaches_all_rigs(settings: Mapping[str, Any], tmp_path: Path, secure: bool) -> None:
    keys = str(make_keys(tmp_path / "keys")) if secure else ""
    router = Serving(tmp_path / "router", {"service": {"keys": keys}}, command="router")

    def rig(name: str) -> Serving:
        behind = {"connect": [router.endpoint], "connect_images": [router.image_endpoint], "keys": keys, "name": name}
        return Serving(tmp_path / name, {**settings, "service": {**settings["service"], **behind}})

    one, two = rig("one"), rig("two")
    options: dict[str, Any] = {"timeout_s": 10.0, **({"keys": keys, "certificate": "op"} if secure else {})}
    who = "rig" if secure else "tcp/"
    with serving(one, router, two):
        until(lambda: len(rigs((router.endpoint,), **options)) == 2, 20, "two rigs are not seen")
        typed = ["--connect", router.endpoint, *(["--keys", keys, "--as", "op"] if secure else [])]
        command = [sys.executable, "-m", "viewsep", "rigs", "--json", *typed]
        listed = json.loads(subprocess.run(command, capture_output=True, timeout=60, check=True).stdout)
        assert listed == [{"name": name, "roles": ["engine", "rig"]} for name in ("one", "two")]
        with Client("one", (router.endpoint,), **options) as client:
            assert client.manifest()["images"] == [router.image_endpoint, one.image_endpoint]
            said = client.status()
            assert (said.name, said.alive) == ("one", ("engine", "rig"))
            with client.images() as pictures:
                picture = until(lambda: pictures.receive(0), 10, "no picture")
                assert picture is not None
                assert picture.decode().image.shape == (128, 128, 3)
                assert until(lambda: "images" in router.log, 5, "nobody is logged")
            client.move(joints_deg=(5.0, 6.0))
        with Client("two", (router.endpoint,), **options) as client:
            said = client.status()
            assert said.name == "two"
            assert said.rig is not None
            assert [joint.setpoint_deg for joint in said.rig.motion.joints] == [0.0, 0.0]
        assert router.log.count(f"{who}") >= 4
        assert "connected (control)" in router.log
        if secure:
            assert "op connected (control)" in router.log
            with Client("one", (router.endpoint,), keys=keys, certificate="view") as viewer:
                assert viewer.status().name == "one"
                before = one.log
                with pytest.raises(Exception, match="not running, or not allowed"):
                    viewer.stop("never")
                assert "never" not in one.log[len(before) :]
        assert router.end(signal.SIGTERM) == 0
        assert "Traceback" not in router.log
