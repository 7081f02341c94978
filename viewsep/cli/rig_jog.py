"""`viewsep rig jog`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from viewsep.cli.console import people, results
from viewsep.cli.rig_dry_run import print_packets
from viewsep.cli.rig_interrupt import interrupt_noted, unless
from viewsep.clock import MonotonicClock
from viewsep.config import load_config
from viewsep.drivers.dynamixel.motion import DynamixelMotion
from viewsep.errors import BadInput, Interrupted
from viewsep.interfaces import JointLimits
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

    def goal(at_rad: Sequence[float]) -> list[float]:
        turned = _goal(settings.servos[index].joint, at_rad[index], by_deg, to_deg)
        return [turned if other == index else q for other, q in enumerate(at_rad)]

    if dry_run:
        print_packets(settings, lambda at_rad: [goal(at_rad)])
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
            aim = goal(motion.read_state().position_rad)
            _, state = move_and_wait(motion, clock, aim, watch, settings.tolerance_rad)
            results.print(_sentence(joint, index, state), highlight=False)
        except Interrupted:
            motion.stop()
            results.print(_sentence(joint, index, motion.read_state()), highlight=False)
            raise
        finally:
            motion.close()


def _goal(limit: JointLimits, at_rad: float, by_deg: float | None, to_deg: float | None) -> float:
    """The angle to turn to. Raises BadInput outside the joint's limits."""
    goal = float(np.radians(to_deg)) if to_deg is not None else at_rad + float(np.radians(by_deg or 0.0))
    if not (np.isfinite(goal) and limit.lower_rad - 1e-6 <= goal <= limit.upper_rad + 1e-6):
        raise BadInput(
            f"joint {limit.name!r}: set-point {np.degrees(goal):.2f} deg is outside "
            f"[{np.degrees(limit.lower_rad):g}, {np.degrees(limit.upper_rad):g}] deg"
        )
    return goal


def _sentence(joint: str, index: int, state: JointState) -> str:
    at, goal = np.degrees(state.position_rad[index]), np.degrees(state.setpoint_rad[index])
    return f"{joint}: {at:.2f} deg, set-point {goal:.2f} deg"
