"""Looks a bus of servos over: what is right, what is wrong, what could be better, and what to do about it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from viewsep.drivers.checks import Check, Verdict, check
from viewsep.drivers.dynamixel.bus import Bus, Found
from viewsep.drivers.dynamixel.checks import servo_checks
from viewsep.drivers.dynamixel.control_table import control_table, x_series
from viewsep.drivers.dynamixel.errors import NoReply, PortLost
from viewsep.drivers.dynamixel.port import latency_file, usb_latency_s
from viewsep.drivers.dynamixel.servo import STATE_FIRST, STATE_LAST
from viewsep.drivers.dynamixel.settings import ServoSettings

READS = 50
ENOUGH_HZ = 50.0
FASTER_BAUD = 1_000_000
BYTES_PER_SERVO = 11 + 14.5  # a status packet with the state, a byte more at every other time
BYTES_OF_REQUEST = 14


def examine(bus: Bus, wanted: Sequence[ServoSettings] = (), fix: bool = False) -> Iterator[Check]:
    """Look at the port, then at every servo that answers or should, then at the line; `fix` sets return delays to 0."""
    try:
        bus.open()
        yield from _port(bus)
        yield from _servos(bus, wanted, fix)
    except PortLost as error:
        yield Check("port", Verdict.BAD, bus.port, str(error))


def _port(bus: Bus) -> Iterator[Check]:
    yield Check("port", Verdict.GOOD, bus.port)
    path, latency_s = Path(bus.port), usb_latency_s(bus.port)
    stable = [link for link in Path("/dev/serial/by-id").glob("*") if link.resolve() == path.resolve()]
    if stable:
        remedy = f"use {stable[0]}, which stays when it is plugged anew"
        yield check("name of the port", path.is_symlink(), bus.port, remedy, Verdict.BETTER)
    if latency_s is not None:
        remedy = (
            f"`echo 1 | sudo tee {latency_file(bus.port)}`; for good, as a udev rule: "
            'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"'
        )
        yield check("latency timer", latency_s <= 1e-3, f"{latency_s * 1e3:.0f} ms", remedy, Verdict.BETTER)


def _servos(bus: Bus, wanted: Sequence[ServoSettings], fix: bool) -> Iterator[Check]:
    found = bus.ping_all()
    if damaged := bus.statistics.damaged:
        remedy = "do two servos have the same id? Connect them one by one; otherwise check the cables"
        yield Check("answers", Verdict.BETTER, f"{damaged} damaged", remedy)
    known = {servo.servo_id: servo for servo in wanted}
    for servo_id, servo in known.items():
        if servo_id not in {one.servo_id for one in found}:
            remedy = f"check power, cable, id and baud: `viewsep rig scan --port {bus.port}`"
            yield Check(f"servo {servo_id} (joint {servo.joint.name!r})", Verdict.BAD, "no answer", remedy)
    if not found:
        remedy = f"check power, cables and baud: `viewsep rig scan --port {bus.port}` tries every baud"
        yield Check("servos", Verdict.BAD, f"none at {bus.baud} baud", remedy)
        return
    for one in found:
        yield from servo_checks(bus, one, known.get(one.servo_id), bool(wanted), fix)
    yield from _line(bus, found)


def _line(bus: Bus, found: Sequence[Found]) -> Iterator[Check]:
    """How well and how fast the line works."""
    read = [one for one in found if one.model_number in x_series()]
    began_s = time.monotonic()
    failed = sum(_goes_wrong(bus, read, found[turn % len(found)]) for turn in range(READS))
    each_s = (time.monotonic() - began_s) / READS
    what = f"states of {len(read)} servos" if read else "pings"
    said = f"{failed} of {READS} {what} failed, {each_s * 1e3:.1f} ms each"
    yield check("line", failed == 0, said, "check plugs, cable length and termination")
    if read:
        remedy = "set latency timer and return delay as above; is the machine busy?"
        yield check("state rate", each_s * ENOUGH_HZ <= 1.0, f"{1.0 / each_s:.0f} Hz", remedy, Verdict.BETTER)
        rate_hz = bus.baud / 10 / (BYTES_OF_REQUEST + (1 + BYTES_PER_SERVO) * len(read))
        remedy = f"set the servos and dynamixel.baud to {FASTER_BAUD}"
        said = f"{bus.baud}: at most {rate_hz:.0f} states of {len(read)} servos per second"
        yield check("baud", rate_hz >= ENOUGH_HZ, said, remedy, Verdict.BETTER)


def _goes_wrong(bus: Bus, read: Sequence[Found], one: Found) -> bool:
    """Read the state of those that have one, or ping `one`; whether anything was lost or damaged."""
    before = bus.statistics
    if read:
        table = control_table(read[0].model_number, read[0].firmware)
        first = table[STATE_FIRST].address
        bus.read_what_answers([servo.servo_id for servo in read], first, table[STATE_LAST].end - first)
    else:
        with suppress(NoReply):
            bus.ping(one.servo_id, retries=0)
    now = bus.statistics
    return (now.timeouts, now.damaged, now.strange) != (before.timeouts, before.damaged, before.strange)
