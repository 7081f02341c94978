"""`viewsep rig home`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from viewsep.cli.console import people, results
from viewsep.cli.rig_dry_run import print_packets
from viewsep.cli.rig_interrupt import interrupt_noted, unless
from viewsep.clock import MonotonicClock
from viewsep.config import geometry_of, load_config
from viewsep.config_file import set_servo
from viewsep.drivers.dynamixel.bus import Bus
from viewsep.drivers.dynamixel.homing import zero_at_stop, zero_by_hand
from viewsep.drivers.dynamixel.motion import DynamixelMotion
from viewsep.drivers.dynamixel.servo import Servo, handshake
from viewsep.drivers.dynamixel.settings import BusSettings
from viewsep.errors import BadConfig, BadInput
from viewsep.moves import move_and_wait
from viewsep.servo_rig import hardware_settings


def home(
    config: Annotated[Path, typer.Option(help="The rig's configuration.", show_default=False)],
    joint: Annotated[str | None, typer.Option(help="Joint whose zero is to be found.", show_default=False)] = None,
    by_hand: Annotated[bool, typer.Option("--by-hand", help="Let go of the joint; turn it to its zero.")] = False,
    seconds: Annotated[float, typer.Option(min=1, max=600, help="With --by-hand: how long it is free.")] = 15.0,
    at_stop: Annotated[bool, typer.Option("--at-stop", help="Drive gently against a mechanical stop.")] = False,
    stop_deg: Annotated[
        float | None, typer.Option(help="With --at-stop: the angle of the stop.", show_default=False)
    ] = None,
    backwards: Annotated[bool, typer.Option("--backwards", help="With --at-stop: towards smaller angles.")] = False,
    effort: Annotated[
        float, typer.Option(min=0.01, max=5, help="With --at-stop: share of full output, or A where it is measured.")
    ] = 0.2,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the packets of driving to zero.")] = False,
) -> None:
    """Drive all joints to zero, or find where the zero of one is and save it in the configuration.

    The file before is kept as FILE.bak. With --by-hand, Ctrl-C ends the waiting and leaves the file as it was.

    Examples:

        viewsep rig home --config rig.toml

        viewsep rig home --config rig.toml --joint pan --by-hand

        viewsep rig home --config rig.toml --joint tilt --at-stop --stop-deg 65
    """
    loaded = load_config(config)
    settings = hardware_settings(loaded, str(config))
    if by_hand and at_stop:
        raise BadInput("--by-hand and --at-stop exclude each other")
    if at_stop and stop_deg is None:
        raise BadInput("--at-stop needs --stop-deg: the joint's angle at the stop")
    if stop_deg is not None and not abs(stop_deg) <= 360.0:
        raise BadInput(f"--stop-deg {stop_deg} is no angle of a joint: give -360 to 360")
    if not (by_hand or at_stop):
        if joint is not None:
            raise BadInput("--joint goes with --by-hand or --at-stop; one joint alone is turned by `viewsep rig jog`")
        goal = geometry_of(loaded.rig).home()
        if dry_run:
            print_packets(settings, lambda at_rad: [goal])
        else:
            _drive_home(settings, goal)
        return
    if dry_run:
        raise BadInput("--dry-run goes without --by-hand and --at-stop: what they send depends on what they find")
    names = [servo.joint.name for servo in settings.servos]
    if joint not in names:
        raise BadInput(f"--joint {joint!r}: the joints in {config} are {', '.join(names)}")
    index = names.index(joint)

    def find(servo: Servo, ended: Callable[[], bool]) -> int:
        if by_hand:
            people.print(f"{joint} is free for {seconds:g} s: turn it to its zero", highlight=False)
            return zero_by_hand(servo, MonotonicClock(), seconds, _show, ended)
        stop_rad = float(np.radians(stop_deg or 0.0))
        return zero_at_stop(servo, MonotonicClock(), -1 if backwards else 1, stop_rad, effort, _show, ended)

    with interrupt_noted() as ended:
        zero = _with_servo(settings, index, lambda servo: find(servo, ended))
        if not ended():
            _check_zero(settings, index, zero)
            backup = set_servo(config, index, "zero_counts", zero)
            before = settings.servos[index].zero_counts
            results.print(f"{joint}: zero_counts = {zero} (before: {before}, kept in {backup})", soft_wrap=True)


def _check_zero(settings: BusSettings, index: int, zero: int) -> None:
    """Raises BadConfig when the servo cannot reach the rig's limits from there."""
    servos = list(settings.servos)
    servos[index] = servos[index].with_zero(zero)
    try:
        replace(settings, servos=tuple(servos)).check()
    except BadConfig as error:
        raise BadConfig(f"zero_counts = {zero} was found but not saved: {error}") from error


def _with_servo(settings: BusSettings, index: int, act: Callable[[Servo], int]) -> int:
    bus = Bus(settings.port, settings.baud, retries=settings.retries)
    bus.open()
    try:
        return act(handshake(bus, settings.servos)[index])
    finally:
        bus.close()


def _show(counts: int) -> None:
    if people.is_terminal:
        people.print(f"{counts} counts ", end="\r", highlight=False)


def _drive_home(settings: BusSettings, goal: tuple[float, ...]) -> None:
    clock = MonotonicClock()
    motion = DynamixelMotion(settings, clock)
    with interrupt_noted() as ended:
        motion.connect()
        try:
            _, state = move_and_wait(motion, clock, goal, unless(ended), settings.tolerance_rad)
        finally:
            motion.close()
    for limit, position in zip(motion.limits(), state.position_rad, strict=True):
        results.print(f"{limit.name}: {np.degrees(position):.2f} deg", highlight=False)
