"""Looks a bus of servos over: what is right, what is wrong, what could be better, and what to do about it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

from viewsep.drivers.dynamixel.alerts import in_words
from viewsep.drivers.dynamixel.bus import Bus, Found
from viewsep.drivers.dynamixel.control_table import X_SERIES, control_table
from viewsep.drivers.dynamixel.errors import BusError
from viewsep.drivers.dynamixel.port import latency_file, usb_latency_s
from viewsep.drivers.dynamixel.servo import Servo
from viewsep.drivers.dynamixel.settings import ServoSettings
from viewsep.errors import RigError

READS = 50
ENOUGH_HZ = 50.0
FASTER_BAUD = 1_000_000
WATCHDOG_FIRMWARE = 38
BYTES_PER_SERVO = 11 + 14.5  # a status packet with the state, a byte more at every other time
BYTES_OF_REQUEST = 14


class Verdict(StrEnum):
    """Of one check; what could be better does not fail."""

    GOOD = "pass"
    BETTER = "could be better"
    BAD = "fail"


@dataclass(frozen=True, slots=True)
class Check:
    """One thing that was looked at: what was found, and the remedy where it is not good."""

    name: str
    verdict: Verdict
    found: str
    remedy: str = ""


def examine(bus: Bus, wanted: Sequence[ServoSettings] = ()) -> Iterator[Check]:
    """Look at the port, then at every servo that answers or should. Raises PortLost when the port cannot be used."""
    bus.open()
    yield from _port(bus)
    found = bus.ping_all()
    known = {servo.servo_id: servo for servo in wanted}
    for servo_id, servo in known.items():
        if servo_id not in {one.servo_id for one in found}:
            remedy = "check power, cable, id and baud: `viewsep rig scan --port " + bus.port + "`"
            yield Check(f"servo {servo_id} (joint {servo.joint.name!r})", Verdict.BAD, "no answer", remedy)
    if not found:
        remedy = "check power, cables and baud: `viewsep rig scan --port " + bus.port + "` tries every baud"
        yield _check("servos", False, f"none at {bus.baud} baud", remedy)
        return
    for one in found:
        yield from _servo(bus, one, known.get(one.servo_id), bool(wanted))
    yield from _line(bus, found)


def _port(bus: Bus) -> Iterator[Check]:
    yield Check("port", Verdict.GOOD, bus.port)
    path, latency_s = Path(bus.port), usb_latency_s(bus.port)
    stable = [link for link in Path("/dev/serial/by-id").glob("*") if link.resolve() == path.resolve()]
    if stable and path not in stable:
        yield Check(
            "name of the port", Verdict.BETTER, bus.port, f"use {stable[0]}, which stays when it is plugged anew"
        )
    if latency_s is not None:
        remedy = (
            f"`echo 1 | sudo tee {latency_file(bus.port)}`; for good, as a udev rule: "
            'ACTION=="add", SUBSYSTEM=="usb-serial", DRIVER=="ftdi_sio", ATTR{latency_timer}="1"'
        )
        yield _check("latency timer", latency_s <= 1e-3, f"{latency_s * 1e3:.0f} ms", remedy, Verdict.BETTER)


def _servo(bus: Bus, found: Found, wanted: ServoSettings | None, configured: bool) -> Iterator[Check]:
    who = f"servo {found.servo_id}"
    if wanted is not None:
        who += f" (joint {wanted.joint.name!r})"
        right = not wanted.model or wanted.model.upper() == found.model
        remedy = f"the configuration says {wanted.model}: exchange the servo or correct the file"
        yield _check(f"{who}: model", right, found.model, remedy)
    else:
        remedy = "no joint of the configuration has this id" if configured else ""
        yield Check(f"{who}: model", Verdict.BETTER if configured else Verdict.GOOD, found.model, remedy)
    if found.model_number not in X_SERIES:
        return
    remedy = f"update it with DYNAMIXEL Wizard: before {WATCHDOG_FIRMWARE} there is no bus watchdog"
    yield _check(f"{who}: firmware", found.firmware >= WATCHDOG_FIRMWARE, str(found.firmware), remedy)
    try:
        yield from _registers(bus, who, found, wanted)
    except (RigError, KeyError) as error:
        yield Check(f"{who}: registers", Verdict.BAD, str(error), "is it a servo of the X series?")


def _registers(bus: Bus, who: str, found: Found, wanted: ServoSettings | None) -> Iterator[Check]:
    table = control_table(found.model_number, found.firmware)

    def read(name: str) -> int:
        return bus.read(found.servo_id, table[name])

    def read_si(name: str) -> float:
        return read(name) * table[name].scale

    errors = in_words(read("Hardware Error Status"))
    yield _check(
        f"{who}: hardware", not errors, errors or "no error", "then `viewsep clear-fault`, or switch it off and on"
    )
    hot, limit = read_si("Present Temperature"), read_si("Temperature Limit")
    yield _check(f"{who}: temperature", hot <= limit, f"{hot:.0f} of at most {limit:.0f} degC", "let it cool down")
    volts, low, high = read_si("Present Input Voltage"), read_si("Min Voltage Limit"), read_si("Max Voltage Limit")
    found_volts = f"{volts:.1f} V, allowed {low:.1f} to {high:.1f} V"
    yield _check(f"{who}: supply", low <= volts <= high, found_volts, "check the supply and the cables")
    delay = read("Return Delay Time")
    remedy = "set Return Delay Time to 0, which makes every answer come sooner"
    yield _check(f"{who}: return delay", delay == 0, f"{delay * 2} us", remedy, Verdict.BETTER)
    level = read("Status Return Level")
    yield _check(
        f"{who}: status return level", level == 2, str(level), "viewsep sets 2 when it connects", Verdict.BETTER
    )
    if wanted is None:
        return
    mode = read("Operating Mode")
    remedy = f"viewsep sets {wanted.operating_mode} when it connects"
    yield _check(f"{who}: operating mode", mode == wanted.operating_mode, str(mode), remedy, Verdict.BETTER)
    try:
        Servo(bus, wanted, table).check_limits()
        yield Check(f"{who}: limits", Verdict.GOOD, "the servo's allow the rig's")
    except BusError:
        raise
    except RigError as error:
        yield Check(f"{who}: limits", Verdict.BAD, "too narrow", str(error))


def _line(bus: Bus, found: Sequence[Found]) -> Iterator[Check]:
    """How well and how fast the line works."""
    before, began_s = bus.statistics, time.monotonic()
    for turn in range(READS):
        bus.ping(found[turn % len(found)].servo_id)
    each_ms = (time.monotonic() - began_s) / READS * 1e3
    failed = bus.statistics.retries - before.retries
    said = f"{failed} of {READS} pings had to be repeated, {each_ms:.1f} ms each"
    yield _check("line", failed == 0, said, "check plugs, cable length and termination")
    rate_hz = bus.baud / 10 / (BYTES_OF_REQUEST + (1 + BYTES_PER_SERVO) * len(found))
    remedy = f"set the servos and dynamixel.baud to {FASTER_BAUD}"
    said = f"{bus.baud}: at most {rate_hz:.0f} states of {len(found)} servos per second"
    yield _check("baud", rate_hz >= ENOUGH_HZ, said, remedy, Verdict.BETTER)


def _check(name: str, good: bool, found: str, remedy: str, otherwise: Verdict = Verdict.BAD) -> Check:
    return Check(name, Verdict.GOOD, found) if good else Check(name, otherwise, found, remedy)
