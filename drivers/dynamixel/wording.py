"""Instruction packets in words, for people who read what would be sent."""

from __future__ import annotations

from viewsep.drivers.dynamixel.bus import CLEAR, HEADER, REBOOT, SYNC_WRITE, WRITE
from viewsep.drivers.dynamixel.control_table import ControlTable

NAMES = {WRITE: "write", SYNC_WRITE: "write to several", REBOOT: "start anew", CLEAR: "forget turns"}


def explain(packet: bytes, table: ControlTable) -> str:
    """What a whole instruction packet says, e.g. `servo 1: write Torque Enable = 1`."""
    servo_id, instruction = packet[4], packet[HEADER]
    parameters = packet[HEADER + 1 : -2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
    said = f"servo {servo_id}: {NAMES.get(instruction, f'instruction {instruction}')}"
    if instruction != WRITE:
        return said
    address, data = int.from_bytes(parameters[:2], "little"), parameters[2:]
    for register in table.registers.values():
        if (register.address, register.size) == (address, len(data)):
            return f"{said} {register.name} = {register.decode(data)}"
    return f"{said} {data.hex(' ').upper()} at address {address}"
