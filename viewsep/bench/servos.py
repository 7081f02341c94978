"""How fast servos can be read: the motion driver beside dynamixel-sdk's own group read, on one emulated bus."""

from __future__ import annotations

import json
import math
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

import numpy as np
from dynamixel_sdk import COMM_SUCCESS, GroupSyncRead, PacketHandler, PortHandler

from viewsep.clock import MonotonicClock
from viewsep.drivers.dynamixel.motion import DynamixelMotion
from viewsep.drivers.dynamixel.settings import BusSettings, ServoSettings
from viewsep.errors import RigError
from viewsep.interfaces import JointLimits

FIRST, SIZE = 122, 14  # what the driver reads as well: Moving to Present Position
ROUNDS = 3  # of both, in turns, so that a busy moment of the machine meets both
Figures = Mapping[str, Mapping[str, float]]


def measure_servos(seconds: float, baud: int) -> Figures:
    """Cycles per second, CPU share of one core and bytes per cycle, for 1, 2 and 3 servos: medians over `ROUNDS`.

    The driver's bytes are counted, those of the SDK, which has no counter, follow from its packets. The emulated servos
    are a process of their own and their bytes take no time, so `line_hz` says what a real line of
    this baud allows. Raises RigError.
    """
    figures = {}
    with _emulated(baud) as port:
        for count in (1, 2, 3):
            rounds = [
                (_driver(port, baud, count, seconds), _raw_sdk(port, baud, count, seconds)) for _ in range(ROUNDS)
            ]
            for name, rows in zip(("driver", "SDK alone"), zip(*rounds, strict=True), strict=True):
                hz, cpu, size = np.median(np.array(rows), axis=0)
                line_hz = baud / 10.0 / size
                figures[f"{count} servos, {name}"] = {"hz": hz, "cpu_share": cpu, "bytes": size, "line_hz": line_hz}
    return {name: {key: float(value) for key, value in row.items()} for name, row in figures.items()}


@contextmanager
def _emulated(baud: int) -> Iterator[str]:
    """Three emulated servos in a process of their own; the port."""
    command = [sys.executable, "-m", "viewsep", "rig", "emulate", "--preset", "wrist", "--baud", str(baud), "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        said = process.stdout.readline()
        try:
            if not said:
                raise RigError("the emulated servos do not start")
            yield str(json.loads(said)["port"])
        finally:
            process.send_signal(signal.SIGTERM)


def _driver(port: str, baud: int, count: int, seconds: float) -> tuple[float, float, float]:
    """The motion driver, reading as often as it can."""
    free = JointLimits("joint", -math.inf, math.inf, 1.0)
    servos = tuple(ServoSettings(free, servo_id, extended=True) for servo_id in range(1, count + 1))
    motion = DynamixelMotion(BusSettings(port, servos, baud, state_hz=1e6), MonotonicClock())
    motion.connect()
    try:
        before, began_s, cpu_s = motion.counters(), time.monotonic(), time.process_time()
        since_ns = time.monotonic_ns()
        time.sleep(seconds)
        wall_s, spent_s, counted = time.monotonic() - began_s, time.process_time() - cpu_s, motion.counters()
        cycles = sum(state.stamp_ns > since_ns for state in motion.history(since_ns))
    finally:
        motion.close()
    moved = sum(counted[way] - before[way] for way in ("bytes_sent", "bytes_received"))
    return cycles / wall_s, spent_s / wall_s, moved / max(cycles, 1)


def _raw_sdk(port: str, baud: int, count: int, seconds: float) -> tuple[float, float, float]:
    """The SDK's group read in a loop, as its examples use it."""
    handler = PortHandler(port)
    handler.setBaudRate(baud)
    group = GroupSyncRead(handler, PacketHandler(2.0), FIRST, SIZE)
    for servo_id in range(1, count + 1):
        group.addParam(servo_id)
    cycles, began_s, cpu_s = 0, time.monotonic(), time.process_time()
    while time.monotonic() - began_s < seconds:
        cycles += int(group.txRxPacket() == COMM_SUCCESS)
    wall_s, spent_s = time.monotonic() - began_s, time.process_time() - cpu_s
    handler.closePort()
    return cycles / wall_s, spent_s / wall_s, 14.0 + count * (1 + 11 + SIZE)
