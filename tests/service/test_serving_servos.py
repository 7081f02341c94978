"""A rig of servos is served like any other: emulated ones, in real time."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from processes import Serving, complete, rig_of, serving, still, until

from viewsep.service.status import RigStatus


def turned_deg(rig: RigStatus) -> float:
    """The joint turns freely: its home is the nearest whole turn."""
    return math.remainder(rig.motion.joints[0].position_deg, 360.0)


@pytest.mark.alone
def test_a_task_on_emulated_servos_ends_with_the_right_object(settings: Mapping[str, Any], tmp_path: Path) -> None:
    servos = [{"joint": "pan", "id": 1, "mode": "extended", "model": "XL430-W250"}]
    bus = {"port": "emulated", "baud": 1_000_000, "emulated_speed": 4.0, "lost_s": 2.0, "watchdog_s": 2.0}
    rig = {"backend": "dynamixel", "preset": "turntable"}
    service = Serving(tmp_path, {**settings, "rig": rig, "dynamixel": {**bus, "servos": servos}})
    with serving(service), service.client("ana") as ana:
        task = ana.start(seed=1)
        result = ana.wait(task, timeout_s=120)
        assert result.object == "product_7", result.reason
        motion = rig_of(ana).motion
        assert [joint.temperature_c for joint in motion.joints] == [30.0]
        assert motion.fault == ""
        assert motion.counters["instructions"] > 100
        ana.home()
        until(lambda: still(ana.status()) and abs(turned_deg(rig_of(ana))) < 1.0, 30, "not at home")
    assert complete(result, service.folder) == result.looks > 1
