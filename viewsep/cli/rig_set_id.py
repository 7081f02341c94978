"""`viewsep rig set-id`."""

from __future__ import annotations

from typing import Annotated

import typer

from viewsep.cli.console import people
from viewsep.cli.rig_scan import Port
from viewsep.drivers.dynamixel.bus import BAUDS, Bus, Found
from viewsep.drivers.dynamixel.control_table import control_table
from viewsep.errors import BadInput

LARGEST = 252


def set_id(
    port: Port,
    to: Annotated[int, typer.Option(min=0, max=LARGEST, help="The new id.", show_default=False)],
    servo: Annotated[
        int | None, typer.Option("--id", min=0, max=LARGEST, help="The servo's id now.", show_default="the only one's")
    ] = None,
    baud: Annotated[int, typer.Option(help="Baud of the servo.")] = 57600,
) -> None:
    """Give a servo another id. They leave the factory with id 1: connect one at a time, and give each its own.

    The servo keeps it without power. Two servos with one id cannot be told apart: never connect those together.

    Examples:

        viewsep rig set-id --port /dev/ttyUSB0 --to 2

        viewsep rig set-id --port /dev/ttyUSB0 --id 1 --to 3 --baud 1000000
    """
    if baud not in BAUDS:
        raise BadInput(f"--baud {baud}: servos know {', '.join(str(known) for known in sorted(BAUDS))}")
    bus = Bus(port, baud)
    bus.open()
    try:
        found = bus.ping_all()
        one = _meant(found, servo, bus)
        if to in {other.servo_id for other in found}:
            raise BadInput(f"--to {to}: a servo on {port} has that id already; choose another")
        table = control_table(one.model_number, one.firmware)
        if bus.read(one.servo_id, table["Torque Enable"]):
            raise BadInput(
                f"servo {one.servo_id} holds its joint, and keeps its id for so long: switch its power off and on"
            )
        bus.write_unanswered(one.servo_id, table["ID"], to)  # it may answer by the old id, or by the new one
        bus.ping(to)
    finally:
        bus.close()
    people.print(f"servo {one.servo_id} ({one.model}) has id {to} now", highlight=False)


def _meant(found: list[Found], servo: int | None, bus: Bus) -> Found:
    """The servo whose id is to be changed. Raises BadInput."""
    ids = ", ".join(str(one.servo_id) for one in found)
    chosen = [one for one in found if servo in (None, one.servo_id)]
    if not found:
        raise BadInput(
            f"no servo answers on {bus.port} at {bus.baud} baud: check power and cables, and find its baud with "
            "`viewsep rig scan`; where two have the same id, connect one at a time"
        )
    if not chosen:
        raise BadInput(f"--id {servo}: the servos on {bus.port} have the ids {ids}")
    if len(chosen) > 1:
        raise BadInput(f"servos {ids} are on {bus.port}: say which with --id, or connect one at a time")
    return chosen[0]
