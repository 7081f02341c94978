"""An emulated servo in a test's hands: everything one can do to it around its bus."""

from __future__ import annotations

from viewsep.drivers.dynamixel.control_table import STEP_RAD
from viewsep.interfaces import Clock
from viewsep.sim.dynamixel.behaviour import OVERLOAD_ALERT, Behaviour, Event
from viewsep.sim.dynamixel.models import LIVE


class EmulatedServo(Behaviour):
    """A servo of the X series on an emulated bus, and access around the bus, for any number of threads.

    `position` is the encoder's count at the start, `load` what the joint asks of the motor as a fraction of its full
    output, `goal_error` by how many counts it comes to rest beside every goal, `boot_s` how long a reboot takes.
    Raises RigError for a model or baud rate there is not.
    """

    def __init__(
        self,
        servo_id: int = 1,
        model: str = "XL430-W250",
        *,
        clock: Clock,
        baud: int = 57600,
        firmware: int = 47,
        backlash_rad: float = 0.0,
        load: float = 0.0,
        position: float = 2048,
        goal_error: float = 0.0,
        boot_s: float = 0.1,
    ) -> None:
        self.clock = clock
        super().__init__(
            servo_id,
            model,
            now_ns=clock.now_ns(),
            baud=baud,
            firmware=firmware,
            play=backlash_rad / STEP_RAD,
            load=load,
            position=position,
            goal_error=goal_error,
            boot_s=boot_s,
        )

    def read(self, name: str) -> int:
        """A register's value now. Raises KeyError when the model has no such register."""
        now_ns = self.clock.now_ns()
        with self.lock:
            self.advance(now_ns)
            self.refresh(now_ns)
            return self.registers[name]

    __getitem__ = read

    def poke(self, name: str, value: int) -> None:
        """Set a register as if the servo had done it itself: no rule is asked, but it has its effects.

        Live registers stay at the value; temperature, voltage and position become what the value means.
        """
        now_ns = self.clock.now_ns()
        with self.lock:
            self.advance(now_ns)
            if name == "Present Temperature":
                self._temperature_c = value
            elif name == "Present Input Voltage":
                self._voltage_v = value / 10.0
            elif name == "Present Position":
                self._shaft.place(now_ns, self.frame.to_shaft(value))
                self.registers["Goal Position"] = value
            elif name in LIVE:
                self._pinned[name] = value
            elif name == "Hardware Error Status":
                self.registers[name] = 0
                self.set_alert(value, now_ns)
            else:
                self.apply([(name, value)], now_ns)
            self._look_around(now_ns)

    @property
    def counts(self) -> int:
        """Present Position."""
        return self.read("Present Position")

    def joint_rad_at(self, stamp_ns: int) -> float:
        """Where the joint is behind the gear's play, radians from the encoder's count 0; up to 30 s back."""
        with self.lock:
            self.advance(stamp_ns)
            return self._shaft.at(stamp_ns).joint_position(stamp_ns) * STEP_RAD

    def turn_by_hand(self, angle_rad: float) -> None:
        """Turn the joint. With the torque on only the play gives way."""
        self._change(lambda now_ns: self._shaft.turn(now_ns, angle_rad / STEP_RAD, free=not self.torque))

    def overload(self) -> None:
        """The load has been too high for too long."""
        self.alert(OVERLOAD_ALERT)

    def alert(self, bits: int) -> None:
        """Set bits of Hardware Error Status; those of Shutdown take the torque off."""
        self._change(lambda now_ns: self.set_alert(bits, now_ns))

    def at_time(self, stamp_ns: int, event: Event) -> None:
        """Call `event(stamp_ns)` when the clock has come there."""
        self._change(lambda _now_ns: self._scripted.append((stamp_ns, event)))

    def at_position(self, counts: float, event: Event) -> None:
        """Call `event(stamp_ns)` once, when the shaft passes a count."""
        self._change(lambda _now_ns: self._traps.append((counts, event)))

    @property
    def temperature_c(self) -> int:
        """Of the inside."""
        return self._temperature_c

    @temperature_c.setter
    def temperature_c(self, value: int) -> None:
        self.poke("Present Temperature", value)

    @property
    def voltage_v(self) -> float:
        """Of the supply."""
        return self._voltage_v

    @voltage_v.setter
    def voltage_v(self, value: float) -> None:
        self.poke("Present Input Voltage", round(value * 10))

    @property
    def stuck(self) -> bool:
        """Whether something holds the shaft."""
        return self._shaft.stuck

    @stuck.setter
    def stuck(self, value: bool) -> None:
        self._change(lambda now_ns: self.hold_fast(now_ns, value))

    @property
    def load(self) -> float:
        """What the joint asks of the motor, as a fraction of its full output."""
        return self._load

    @load.setter
    def load(self, value: float) -> None:
        def change(now_ns: int) -> None:
            self._load = value
            self._replan(now_ns)

        self._change(change)

    @property
    def mechanical_stops(self) -> tuple[float, float]:
        """Encoder counts beyond which the shaft does not turn."""
        return self._shaft.stops

    @mechanical_stops.setter
    def mechanical_stops(self, value: tuple[float, float]) -> None:
        def change(now_ns: int) -> None:
            self._shaft.stops = value
            self._replan(now_ns)

        self._change(change)

    def _change(self, change: Event) -> None:
        now_ns = self.clock.now_ns()
        with self.lock:
            self.advance(now_ns)
            change(max(now_ns, self._seen_ns))
