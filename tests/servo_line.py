"""One emulated servo on simulated time, and what a controller says to it."""

from __future__ import annotations

from viewsep.drivers.dynamixel.control_table import control_table, model_number
from viewsep.sim.clock import SimClock
from viewsep.sim.dynamixel.bus import EmulatedBus
from viewsep.sim.dynamixel.packets import Code, Instruction, Parser, Status, encode
from viewsep.sim.dynamixel.servo import EmulatedServo


class Line:
    """One servo, and what a controller says to it."""

    def __init__(self, model: str = "XL430-W250", **servo: float) -> None:
        self.clock = SimClock()
        self.servo = EmulatedServo(1, model, clock=self.clock, **servo)  # type: ignore[arg-type]
        self.bus = EmulatedBus([self.servo])
        self.table = control_table(model_number(model))

    def wait(self, seconds: float) -> None:
        self.clock.sleep_until(self.clock.now_ns() + round(seconds * 1e9))

    def say(self, code: int, params: bytes = b"") -> Status | None:
        replies = self.bus.receive(encode(Instruction(1, code, params)))
        (status,) = Parser().feed(replies[0].data) if replies else [None]
        assert status is None or isinstance(status, Status)
        return status

    def write(self, name: str, value: int) -> int:
        register = self.table[name]
        status = self.say(Code.WRITE, register.address.to_bytes(2, "little") + register.encode(value))
        assert status is not None
        return status.error

    def read(self, name: str) -> int:
        register = self.table[name]
        status = self.say(Code.READ, register.address.to_bytes(2, "little") + register.size.to_bytes(2, "little"))
        assert status is not None
        return register.decode(status.params)


def moving_line(**servo: float) -> Line:
    line = Line("XL430-W250", **servo)
    for name, value in (("Profile Velocity", 100), ("Profile Acceleration", 20), ("Torque Enable", 1)):
        assert line.write(name, value) == 0
    return line
