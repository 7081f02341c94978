"""`--dry-run`: what moving the joints would send."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from viewsep.cli.console import results
from viewsep.drivers.dynamixel.bus import Bus
from viewsep.drivers.dynamixel.packets import written
from viewsep.drivers.dynamixel.servo import handshake
from viewsep.drivers.dynamixel.settings import BusSettings


def print_packets(settings: BusSettings, moves: Callable[[tuple[float, ...]], Sequence[Sequence[float]]]) -> None:
    """Print the packets of connecting and of `moves(angles of the joints now)`, in bytes and words.

    Servos are read, but nothing that changes them is sent. Raises RigError, and what `moves` raises.
    """
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
        at = tuple(servo.angle_rad(servo.read("Present Position")) for servo in servos)
        for move in moves(at):
            goals = [servo.goal_counts(angle) for servo, angle in zip(servos, move, strict=True)]
            at = tuple(servo.angle_rad(goal) for servo, goal in zip(servos, goals, strict=True))
            wanted = {servo.settings.servo_id: goal for servo, goal in zip(servos, goals, strict=True)}
            bus.write_all(wanted, servos[0].table["Goal Position"])
    finally:
        bus.close()
    tables = {servo.settings.servo_id: servo.table for servo in servos}
    for packet in would_be:
        words = written(packet, tables)
        results.print(f"{packet.hex(' ').upper()}  {words}", highlight=False, soft_wrap=True)
    ends = ", ".join(
        f"{servo.settings.joint.name} {np.degrees(q):.2f} deg" for servo, q in zip(servos, at, strict=True)
    )
    results.print(f"nothing was sent; it would end at {ends}", highlight=False, soft_wrap=True)
