"""How a servo behaves: registers that act, motion, what makes it give up.

Nothing runs by itself. The state at a time is a function of what was received before, worked out when somebody asks:
a watchdog trips in time though nobody looks.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator

from viewsep.drivers.dynamixel.control_table import STEPS_PER_TURN, control_table
from viewsep.errors import RigError
from viewsep.sim.dynamixel import control
from viewsep.sim.dynamixel.models import (
    BAUD_RATES,
    CURRENT,
    EXTENDED,
    EXTENDED_GOAL,
    GOALS,
    POSITION,
    PWM,
    VELOCITY,
    factory_values,
    number_of,
)
from viewsep.sim.dynamixel.packets import Error
from viewsep.sim.dynamixel.profile import rest
from viewsep.sim.dynamixel.registers import WATCHDOG_TRIPPED, Refused, Registers
from viewsep.sim.dynamixel.shaft import Shaft

VOLTAGE_ALERT, HEAT_ALERT, ENCODER_ALERT, SHOCK_ALERT, OVERLOAD_ALERT = 0x01, 0x04, 0x08, 0x10, 0x20
WATCHDOG_S = 0.02
IN_POSITION_COUNTS = 10
Event = Callable[[int], None]


class Behaviour:
    """A servo of the X series as its bus knows it. The caller holds `lock`, and says what time it is.

    `play` is the gear's, in counts; the rest is `EmulatedServo`'s.
    """

    def __init__(
        self,
        servo_id: int,
        model: str,
        *,
        now_ns: int,
        baud: int,
        firmware: int,
        play: float,
        load: float,
        position: float,
        goal_error: float,
        boot_s: float,
    ) -> None:
        self.model = model.upper()
        self.lock = threading.RLock()  # the bus puts its own here
        self.silent = False  # its cable is out
        self.goal_error = goal_error
        self.boot_s = boot_s
        self._factory = factory_values(model)
        self._full_current = self._factory.get("Current Limit", 0)
        number = number_of(model)
        self.registers = Registers(control_table(number, firmware), self._factory)
        self.registers["Model Number"], self.registers["Firmware Version"] = number, firmware
        if baud not in BAUD_RATES:
            raise RigError(f"no servo can be set to {baud} baud: use one of {', '.join(map(str, BAUD_RATES))}")
        self.registers["ID"], self.registers["Baud Rate"] = servo_id, BAUD_RATES.index(baud)
        self._shaft = Shaft(position, play, now_ns)
        self._load = load
        self._temperature_c, self._voltage_v = 30, self._rated_voltage_v()
        self._pinned: dict[str, int] = {}
        self._scripted: list[tuple[int, Event]] = []
        self._traps: list[tuple[float, Event]] = []
        self._seen_ns = self._heard_ns = self._boot_ns = self._awake_ns = now_ns
        self._strained_ns = math.inf
        self._turns = 0
        self._boot(now_ns)
        self._awake_ns = now_ns

    @property
    def torque(self) -> bool:
        """Torque Enable."""
        return bool(self.registers["Torque Enable"])

    def hold_fast(self, now_ns: int, stuck: bool = True) -> None:
        """Be stuck, or no longer, from `now_ns` on."""
        self._shaft.stuck = stuck
        self._replan(now_ns)

    @property
    def baud(self) -> int:
        """Bits per second it listens at."""
        return BAUD_RATES[self.registers["Baud Rate"]]

    def awake(self, now_ns: int) -> bool:
        """Whether it hears anything: it does not while it boots or its cable is out."""
        return not self.silent and now_ns >= self._awake_ns

    def heard(self, now_ns: int) -> None:
        """An instruction packet for this servo has come: the watchdog waits anew."""
        self._heard_ns = now_ns

    @property
    def frame(self) -> control.Frame:
        """Between registers and shaft."""
        return control.frame(self.registers, self._turns)

    def write(self, address: int, data: bytes, now_ns: int) -> None:
        """A write from the bus. Raises Refused; then nothing is changed."""
        self.apply(self.checked(address, data), now_ns)

    def checked(self, address: int, data: bytes) -> list[tuple[str, int]]:
        """What a write would set. Raises Refused."""
        writes = self.registers.check(address, data)
        for name, value in writes:
            lower, upper = self._limits(name)
            if not lower <= value <= upper:
                raise Refused(Error.DATA_LIMIT)
        return writes

    def apply(self, writes: list[tuple[str, int]], now_ns: int) -> None:
        """Set registers, with all it means."""
        for name, value in writes:
            if name == "Torque Enable":
                self._set_torque(bool(value), now_ns)
                continue
            self.registers[name] = value
            if name == "Operating Mode":
                self._change_mode()
            elif name == "Drive Mode":
                self._turns = self._turns_now(now_ns)
        if any(name in GOALS for name, _ in writes):
            self._replan(now_ns)
        self._look_around(now_ns)

    def reboot(self, now_ns: int) -> None:
        """Off and on again."""
        self._boot(now_ns)

    def forget_turns(self, now_ns: int) -> None:
        """Multi-turn position back to one turn. Raises Refused while it moves."""
        if self._shaft.now.velocity(now_ns):
            raise Refused(Error.RESULT_FAIL)
        self._turns = self._turns_now(now_ns)
        self._hold(now_ns)

    def advance(self, now_ns: int) -> None:
        """Let everything happen that was due before `now_ns`."""
        while events := [event for event in self._events() if event[0] <= now_ns]:
            stamp_ns, happen = min(events, key=lambda event: event[0])
            self._seen_ns = max(self._seen_ns, int(stamp_ns))
            happen(self._seen_ns)
        self._seen_ns = max(self._seen_ns, now_ns)

    def _events(self) -> Iterator[tuple[float, Event]]:
        watchdog = self.registers["Bus Watchdog"]
        if self.torque:
            if watchdog > 0:
                yield self._heard_ns + round(watchdog * WATCHDOG_S * 1e9), self._trip
            if self._strained_ns < math.inf:
                yield self._strained_ns + control.OVERLOAD_S * 1e9, lambda now: self.set_alert(OVERLOAD_ALERT, now)
        stretch = self._shaft.now
        lower, upper = self._shaft.stops
        if 0.0 < stretch.blocked_s < math.inf and lower <= stretch.motion.goal <= upper:  # it ran on, and comes back
            yield stretch.start_ns + math.ceil(stretch.blocked_s * 1e9), self._replan
        for scripted in self._scripted:
            yield scripted[0], self._once(self._scripted, scripted)
        for trap in self._traps:
            rising = trap[0] > stretch.motion.position_at(0.0)
            passing_s = stretch.motion.passing(trap[0], rising)
            if passing_s < stretch.blocked_s:
                yield stretch.start_ns + math.ceil(passing_s * 1e9), self._once(self._traps, trap)

    def _once(self, events: list[tuple[int, Event]] | list[tuple[float, Event]], event: tuple[float, Event]) -> Event:
        def happen(now_ns: int) -> None:
            events.remove(event)  # type: ignore[arg-type]
            event[1](now_ns)

        return happen

    def _trip(self, now_ns: int) -> None:
        """The watchdog: stop at once and take no goals until it is written 0."""
        self.registers["Bus Watchdog"] = WATCHDOG_TRIPPED
        self.registers["Goal Velocity"] = 0
        self._hold(now_ns)

    def refresh(self, now_ns: int) -> None:
        """Bring the live registers up to date."""
        stretch, frame, registers = self._shaft.now, self.frame, self.registers
        seconds, velocity = stretch.seconds(now_ns), frame.sign * stretch.velocity(now_ns) / control.VELOCITY_UNIT
        effort = 0.0
        if self.torque:
            effort = frame.sign * control.effort(registers, stretch, now_ns, self._load, self._full_current)
        position = frame.to_register(stretch.position(now_ns))
        values = {
            "Realtime Tick": (now_ns - self._boot_ns) // 1_000_000 % 32768,
            "Moving": int(abs(velocity) > registers["Moving Threshold"]),
            "Moving Status": self._moving_status(now_ns, position),
            "Present PWM": round(effort * control.FULL_PWM),
            "Present Load": round(effort * 1000),
            "Present Current": round(effort * self._full_current),
            "Present Velocity": round(velocity),
            "Present Position": math.floor(position + 0.5),
            "Velocity Trajectory": round(frame.sign * stretch.motion.velocity_at(seconds) / control.VELOCITY_UNIT),
            "Position Trajectory": math.floor(frame.to_register(stretch.motion.position_at(seconds)) + 0.5),
            "Present Input Voltage": round(self._voltage_v * 10),
            "Present Temperature": self._temperature_c,
            **self._pinned,
        }
        for name, value in values.items():
            if name in registers:
                registers[name] = value

    def _moving_status(self, now_ns: int, position: float) -> int:
        stretch = self._shaft.now
        seconds = stretch.seconds(now_ns)
        status = 0
        if self.registers["Operating Mode"] in control.POSITION_MODES:
            status |= abs(self.registers["Goal Position"] - position) <= IN_POSITION_COUNTS
            status |= 0x08 * (seconds >= stretch.blocked_s)
        if seconds < stretch.motion.end_s:
            ramped = any(phase.acceleration for phase in stretch.motion.phases)
            level = any(not phase.acceleration for phase in stretch.motion.phases)
            status |= 0x02 | 0x20 * ramped | 0x10 * (level and self.registers["Profile Velocity"] > 0)
        return status

    def _limits(self, name: str) -> tuple[float, float]:
        registers = self.registers
        mode = registers["Operating Mode"]
        if name == "Goal Position" and mode == POSITION:
            return registers["Min Position Limit"], registers["Max Position Limit"]
        if name == "Goal Position":
            return EXTENDED_GOAL
        limit = {"Goal Velocity": "Velocity Limit", "Goal PWM": "PWM Limit", "Goal Current": "Current Limit"}.get(name)
        return (-registers[limit], registers[limit]) if limit else (-math.inf, math.inf)

    def _boot(self, now_ns: int) -> None:
        self.registers.forget_ram()
        self.registers["Goal PWM"] = self.registers["PWM Limit"]
        if "Goal Current" in self.registers:
            self.registers["Goal Current"] = self.registers["Current Limit"]
        self._boot_ns = now_ns
        self._awake_ns = now_ns + round(self.boot_s * 1e9)
        self._turns = self._turns_now(now_ns)
        self._hold(now_ns)
        self._look_around(now_ns)

    def _change_mode(self) -> None:
        """Profile and limits go back to what the mode starts with."""
        mode = self.registers["Operating Mode"]
        self.registers["Profile Velocity"] = self.registers["Profile Acceleration"] = 0
        self.registers["Goal Velocity"] = 0
        self.registers["Goal PWM"] = 0 if mode == PWM else self.registers["PWM Limit"]
        if "Goal Current" in self.registers:
            self.registers["Goal Current"] = 0 if mode == CURRENT else self.registers["Current Limit"]
        if mode in (EXTENDED, POSITION):
            self._turns = self._turns_now(self._seen_ns)

    def _set_torque(self, on: bool, now_ns: int) -> None:
        if on and self.registers["Hardware Error Status"] & self.registers["Shutdown"]:
            return  # only a reboot helps
        if on == self.torque:
            return
        self.registers["Torque Enable"] = int(on)
        if on and self.registers["Operating Mode"] == POSITION:
            self._turns = self._turns_now(now_ns)
        self._hold(now_ns)

    def _hold(self, now_ns: int) -> None:
        """Stay where it is; goals become that."""
        position = self._shaft.now.position(now_ns)
        if self.registers["Operating Mode"] == VELOCITY:
            self.registers["Goal Velocity"] = 0
        self.registers["Goal Position"] = math.floor(self.frame.to_register(position) + 0.5)
        self._shaft.follow(now_ns, rest(position))
        self._strained_ns = math.inf
        if self.torque:
            self._watch_effort()

    def _replan(self, now_ns: int) -> None:
        stretch = self._shaft.now
        position, velocity = stretch.position(now_ns), stretch.velocity(now_ns)
        if not self.torque or self.registers["Bus Watchdog"] == WATCHDOG_TRIPPED:
            self._shaft.follow(now_ns, rest(position))
            return
        spare = control.spare_effort(self.registers, self._load, self._full_current)
        start, held = (position, velocity), spare <= 0.0
        motion = control.plan(
            self.registers, self.frame, self.goal_error, start, 1.0 if held else spare, self._full_current
        )
        self._shaft.follow(now_ns, motion, held=held)
        self._watch_effort()

    def _watch_effort(self) -> None:
        stretch = self._shaft.now
        strained_s = control.strained_s(self.registers, stretch, self._load, self._full_current)
        self._strained_ns = stretch.start_ns + strained_s * 1e9

    def _turns_now(self, now_ns: int) -> int:
        shown = control.sign_of(self.registers) * self._shaft.now.position(now_ns)
        return math.floor((shown + 0.5) / STEPS_PER_TURN)

    def _look_around(self, now_ns: int) -> None:
        voltage = round(self._voltage_v * 10)
        if self._temperature_c > self.registers["Temperature Limit"]:
            self.set_alert(HEAT_ALERT, now_ns)
        if not self.registers["Min Voltage Limit"] <= voltage <= self.registers["Max Voltage Limit"]:
            self.set_alert(VOLTAGE_ALERT, now_ns)

    def set_alert(self, bits: int, now_ns: int) -> None:
        """Set bits of Hardware Error Status; those of Shutdown take the torque off, and the overload's clock stops."""
        self.registers["Hardware Error Status"] |= bits
        self._strained_ns = math.inf
        if bits & self.registers["Shutdown"]:
            self._set_torque(False, now_ns)

    def _rated_voltage_v(self) -> float:
        return {70: 5.0, 140: 11.1}.get(self._factory["Max Voltage Limit"], 12.0)
