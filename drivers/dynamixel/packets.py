"""The SDK's packets, Protocol 2.0, with the byte stuffing that it leaves out when it sends."""

from __future__ import annotations

from collections.abc import Mapping

from dynamixel_sdk.protocol2_packet_handler import Protocol2PacketHandler

from viewsep.drivers.dynamixel.control_table import ControlTable

HEADER = 7  # bytes before the instruction
SYNC_WRITE = 0x83


class Packets(Protocol2PacketHandler):  # type: ignore[misc]  # the SDK has no types
    """The SDK's packet handler, with byte stuffing that reaches the wire."""

    def addStuffing(self, packet: list[int]) -> list[int]:  # noqa: N802
        """Stuff in place: the SDK's own returns a longer packet, which its `txPacket` then does not send."""
        body = bytes(packet[HEADER:-2]).replace(b"\xff\xff\xfd", b"\xff\xff\xfd\xfd")
        packet[5:7] = words(len(body) + 2)
        packet[HEADER:] = [*body, 0, 0]
        return packet

    def as_sent(self, packet: list[int]) -> bytes:
        """The packet as `txPacket` would put it on the wire."""
        wire = _Wire()
        self.txPacket(wire, packet)
        return wire.sent


class _Wire:
    """Takes a packet and sends it nowhere."""

    is_using = False
    sent = b""

    def clearPort(self) -> None:  # noqa: N802
        """Nothing to clear."""

    def writePort(self, packet: list[int]) -> int:  # noqa: N802
        """Keep the packet."""
        self.sent = bytes(packet)
        return len(packet)


def words(*values: int) -> bytes:
    """Each value in two bytes, least significant first."""
    return b"".join(value.to_bytes(2, "little") for value in values)


def written(packet: bytes, tables: Mapping[int, ControlTable]) -> str:
    """In words, what a Write or Sync Write packet sets, e.g. `servo 1: Torque Enable = 1`; `tables` by id."""
    parameters = packet[HEADER + 1 : -2].replace(b"\xff\xff\xfd\xfd", b"\xff\xff\xfd")
    address = int.from_bytes(parameters[:2], "little")
    data = {packet[4]: parameters[2:]}
    if packet[HEADER] == SYNC_WRITE:
        size = int.from_bytes(parameters[2:4], "little")
        starts = range(4, len(parameters), 1 + size)
        data = {parameters[start]: parameters[start + 1 : start + 1 + size] for start in starts}
    said = []
    for servo_id, value in data.items():
        registers = tables[servo_id].registers.values()
        register = next(r for r in registers if r.address == address and r.size == len(value))
        said.append(f"servo {servo_id}: {register.name} = {register.decode(value)}")
    return ", ".join(said)
