"""`viewsep rig jog`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from viewsep.cli.console import people, results
from viewsep.cli.rig_interrupt import interrupt_noted, unless
from viewsep.clock import MonotonicClock
from viewsep.config import load_config
from viewsep.drivers.dynamixel.bus import Bus
from viewsep.drivers.dynamixel.control_table import written
from viewsep.drivers.dynamixel.motion import DynamixelMotion
from viewsep.drivers.dynamixel.servo import handshake
from viewsep.drivers.dynamixel.settings import BusSettings
from viewsep.errors import BadInput, Interrupted
from viewsep.messages import JointState
from viewsep.moves import move_and_wait
from viewsep.servo_rig import hardware_settings


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
        _print_packets(settings, index, by_deg, to_deg)
        return
    clock = MonotonicClock()
    motion = DynamixelMotion(settings, clock)
    with interrupt_noted() as ended:

        def watch(state: JointState) -> None:
            if people.is_terminal:
                people.print(_sentence(joint, index, state), end="\r", highlight=False)
            unless(ended)(state)

        motion.connect()
        try:
            goal = list(motion.read_state().position_rad)
            goal[index] = _goal(settings, index, goal[index], by_deg, to_deg)
            _, state = move_and_wait(motion, clock, goal, watch, settings.tolerance_rad)
            results.print(_sentence(joint, index, state), highlight=False)
        except Interrupted:
            motion.stop()
            results.print(_sentence(joint, index, motion.read_state()), highlight=False)
            raise
        finally:
            motion.close()


def _goal(settings: BusSettings, index: int, at_rad: float, by_deg: float | None, to_deg: float | None) -> float:
    """The angle to turn to. Raises BadInput outside the joint's limits."""
    limit = settings.servos[index].joint
    goal = float(np.radians(to_deg)) if to_deg is not None else at_rad + float(np.radians(by_deg or 0.0))
    if not limit.lower_rad - 1e-6 <= goal <= limit.upper_rad + 1e-6:
        raise BadInput(
            f"joint {limit.name!r}: set-point {np.degrees(goal):.2f} deg is outside "
            f"[{np.degrees(limit.lower_rad):g}, {np.degrees(limit.upper_rad):g}] deg"
        )
    return goal


def _sentence(joint: str, index: int, state: JointState) -> str:
    at, goal = np.degrees(state.position_rad[index]), np.degrees(state.setpoint_rad[index])
    return f"{joint}: {at:.2f} deg, set-point {goal:.2f} deg"


def _print_packets(settings: BusSettings, index: int, by_deg: float | None, to_deg: float | None) -> None:
    """What connecting and moving the joint would send."""
    would_be: list[bytes] = []

    def note(way: str, data: bytes) -> None:
        if way not in "<>":
            would_be.append(data)

    bus = Bus(settings.port, settings.baud, retries=settings.retries, trace=note, dry_run=True)
    bus.open()
    try:
        servos = handshake(bus, settings.servos)
        for servo in servos:
            servo.prepare()
            servo.count_from(None)
        for servo in servos:
            servo.arm(settings.watchdog_s)
        turned, joint = servos[index], settings.servos[index].joint.name
        at = turned.angle_rad(turned.read("Present Position"))
        goal = turned.goal_counts(_goal(settings, index, at, by_deg, to_deg))
        turned.write("Goal Position", goal)
    finally:
        bus.close()
    tables = {servo.settings.servo_id: servo.table for servo in servos}
    for packet in would_be:
        words = written(packet, tables[packet[4]])
        results.print(f"{packet.hex(' ').upper()}  {words}", highlight=False, soft_wrap=True)
    to = np.degrees(turned.angle_rad(goal))
    results.print(f"nothing was sent; {joint} would turn to {to:.2f} deg", highlight=False)
