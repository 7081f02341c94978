"""`viewsep rig jog`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from viewsep.cli.console import people, results
from viewsep.cli.rig_interrupt import interrupt_noted
from viewsep.clock import MonotonicClock
from viewsep.config import load_config
from viewsep.drivers.dynamixel.bus import Bus
from viewsep.drivers.dynamixel.control_table import written
from viewsep.drivers.dynamixel.motion import DynamixelMotion
from viewsep.drivers.dynamixel.servo import handshake
from viewsep.drivers.dynamixel.settings import BusSettings
from viewsep.errors import BadInput, RigError
from viewsep.messages import JointState
from viewsep.servo_rig import hardware_settings

POLL_NS = 50_000_000


def jog(
    config: Annotated[Path, typer.Option(help="The rig's configuration.", show_default=False)],
    joint: Annotated[str, typer.Option(help="Name of the joint.", show_default=False)],
    by_deg: Annotated[float | None, typer.Option(help="Turn it by this much.", show_default=False)] = None,
    to_deg: Annotated[float | None, typer.Option(help="Turn it to this angle.", show_default=False)] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print the packets that would be sent.")] = False,
) -> None:
    """Turn one joint and wait until it has arrived. Ctrl-C stops it.

    With --dry-run the servos are read, but nothing that changes them is sent.

    Examples:

        viewsep rig jog --config rig.toml --joint pan --by-deg 10

        viewsep rig jog --config rig.toml --joint tilt --to-deg 0 --dry-run
    """
    settings = hardware_settings(load_config(config), str(config))
    names = [servo.joint.name for servo in settings.servos]
    if joint not in names:
        raise BadInput(f"--joint {joint!r}: the joints in {config} are {', '.join(names)}")
    if (by_deg is None) == (to_deg is None):
        raise BadInput("give --by-deg or --to-deg")
    index = names.index(joint)
    if dry_run:
        _print_packets(settings, joint, index, by_deg, to_deg)
        return
    clock = MonotonicClock()
    motion = DynamixelMotion(settings, clock)
    with interrupt_noted() as ended:
        motion.connect()
        try:
            goal = list(motion.read_state().position_rad)
            goal[index] = _goal(goal[index], by_deg, to_deg)
            motion.move_to(goal)
            while (state := motion.read_state()).moving and not ended():
                if fault := motion.fault():
                    raise RigError(fault)
                people.print(_sentence(joint, index, state), end="\r", highlight=False)
                clock.sleep_until(clock.now_ns() + POLL_NS)
            if ended():
                motion.stop()
            results.print(_sentence(joint, index, motion.read_state()), highlight=False)
        finally:
            motion.close()


def _goal(position_rad: float, by_deg: float | None, to_deg: float | None) -> float:
    return float(np.radians(to_deg)) if to_deg is not None else position_rad + float(np.radians(by_deg or 0.0))


def _sentence(joint: str, index: int, state: JointState) -> str:
    at, goal = np.degrees(state.position_rad[index]), np.degrees(state.setpoint_rad[index])
    return f"{joint}: {at:.2f} deg, set-point {goal:.2f} deg"


def _print_packets(settings: BusSettings, joint: str, index: int, by_deg: float | None, to_deg: float | None) -> None:
    """What preparing the servo and moving the joint would send."""

    would_be: list[bytes] = []

    def note(way: str, data: bytes) -> None:
        if way not in "<>":
            would_be.append(data)

    bus = Bus(settings.port, settings.baud, trace=note, dry_run=True)
    bus.open()
    try:
        servo = handshake(bus, settings.servos)[index]
        servo.prepare()
        servo.count_from(None)
        at = servo.angle_rad(servo.read("Present Position"))
        goal = servo.goal_counts(_goal(at, by_deg, to_deg))
        servo.write("Goal Position", goal)
        for packet in would_be:
            results.print(f"{packet.hex(' ').upper()}  {written(packet, servo.table)}", highlight=False, soft_wrap=True)
        results.print(
            f"nothing was sent; {joint} would turn to {np.degrees(servo.angle_rad(goal)):.2f} deg", highlight=False
        )
    finally:
        bus.close()
