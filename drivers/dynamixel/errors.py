"""What goes wrong on a servo bus."""

from __future__ import annotations

from viewsep.errors import RigError


class BusError(RigError):
    """Base of the bus' errors."""


class PortLost(BusError):
    """The serial port cannot be opened, is used by another process, or was unplugged."""


class NoReply(BusError):
    """A servo did not answer in time, or only with damaged packets: cable, power, id or baud."""


class ServoRefused(BusError):
    """A servo answered that it will not do what it was asked: a value out of range, a locked register."""
