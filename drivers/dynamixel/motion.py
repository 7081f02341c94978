"""Joints turned by DYNAMIXEL servos: a `MotionBackend`.

One thread reads the servos' state again and again and keeps it with its time; whoever asks gets the newest, whoever
commands takes turns with the thread on the bus. What goes wrong is a fault that stays until it is cleared: every joint
that can be reached is stopped then, and nothing moves any more.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import partial
from itertools import cycle

import numpy as np

from viewsep.drivers.dynamixel.bus import Bus
from viewsep.drivers.dynamixel.errors import BusError, NoReply
from viewsep.drivers.dynamixel.health import Health
from viewsep.drivers.dynamixel.port import Trace
from viewsep.drivers.dynamixel.servo import Reading, Servo, handshake
from viewsep.drivers.dynamixel.settings import BusSettings
from viewsep.errors import MoveRefused, NotConnected, RigError, Timeout, try_all
from viewsep.interfaces import Clock, JointLimits
from viewsep.kinematics import check_setpoints
from viewsep.messages import JointState

MEMORY_S = 20.0
HEALTH_NS = 100_000_000  # between two looks at the health of a servo
PATIENCE_READS = 10  # a joint that does not move yet is given that many readings to start
DEADLINE_SHARE, DEADLINE_S = 1.5, 1.0  # of the time that the profile needs, and on top
TO_CLEAR = "; then clear the fault"


class DynamixelMotion:
    """`MotionBackend` on a bus of servos, for any number of threads. Raises BadConfig for settings that cannot be."""

    def __init__(self, settings: BusSettings, clock: Clock, trace: Trace | None = None) -> None:
        settings.check()
        self._settings = settings
        self._clock = clock
        self._bus = Bus(settings.port, settings.baud, retries=settings.retries, trace=trace)
        self._servos: tuple[Servo, ...] = ()
        self._health: tuple[Health, ...] = ()
        self._states: deque[JointState] = deque(maxlen=round(MEMORY_S * settings.state_hz))
        self._readings: dict[int, Reading] = {}  # of each servo, the newest
        self._heard_ns: dict[int, int] = {}
        self._setpoint_rad: tuple[float, ...] = ()
        self._still = 0  # readings in a row without motion
        self._deadline_ns: int | None = None  # of the move under way
        self._released = False
        self._fault = ""
        self._blind = False  # nothing new can be read
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None

    def connect(self) -> None:
        """Open the port, find every servo, prepare it and let it hold; then begin to read. Raises RigError."""
        if self._thread is not None:
            return
        try:
            self._begin(None)
        except BaseException:
            self._bus.close()
            raise
        self._ending.clear()
        self._thread = threading.Thread(target=self._read_on, name="viewsep servos", daemon=True)
        self._thread.start()

    def limits(self) -> tuple[JointLimits, ...]:
        """Limits of every joint."""
        return tuple(servo.joint for servo in self._settings.servos)

    def move_to(self, position_rad: Sequence[float]) -> tuple[float, ...]:
        """Start moving with the profile's speed; set-points are rounded to the servos' counts.

        The servos have confirmed their goals when this returns. Raises MoveRefused, RigError.
        """
        self._check()
        check_setpoints(position_rad, self.limits())
        with self._bus.together():
            if self._fault:
                raise MoveRefused(self._fault)
            goals = [servo.goal_counts(q) for servo, q in zip(self._servos, position_rad, strict=True)]
            if self._released:
                _each(self._servos, Servo.hold)
                self._released = False
            self._command(goals)
            commanded = tuple(servo.angle_rad(goal) for servo, goal in zip(self._servos, goals, strict=True))
            ways = np.subtract(commanded, self._states[-1].position_rad)
            way_s = max(servo.travel_time_s(way) for servo, way in zip(self._servos, ways, strict=True))
            self._setpoint_rad, self._still = commanded, -PATIENCE_READS
            self._deadline_ns = self._clock.now_ns() + round((DEADLINE_SHARE * way_s + DEADLINE_S) * 1e9)
            self._read_state()
        return commanded

    def read_state(self) -> JointState:
        """The newest read-back. Raises NotConnected, Timeout when it is too old, RigError when none will come."""
        self._check()
        if self._blind:
            raise RigError(self._fault)
        newest = self._states[-1]
        age_s = (self._clock.now_ns() - newest.stamp_ns) * 1e-9
        if age_s > 2 * self._settings.lost_s:
            raise Timeout(f"the newest read-back of the servos is {age_s:.1f} s old: the machine is too busy")
        return newest

    def history(self, since_ns: int) -> tuple[JointState, ...]:
        """Read-backs from the last one at or before `since_ns` on."""
        self._check()
        states = list(self._states)
        first = len(states) - 1
        while first > 0 and states[first].stamp_ns > since_ns:
            first -= 1
        return tuple(states[first:])

    def stop(self) -> None:
        """Brake every joint with its acceleration and hold, or let it go where the settings say so.

        Every servo is tried, then the first error is raised.
        """
        self._check()
        with self._bus.together():
            self._brake()
            with suppress(BusError):  # the reading thread tells when this lasts
                self._read_state()

    def fault(self) -> str:
        """What is wrong and how to clear it."""
        return self._fault

    def clear_fault(self) -> None:
        """Open the port again if it was lost, start servos with a hardware error anew, prepare all and hold.

        Raises RigError with what remains; the fault then stays.
        """
        self._check()
        with self._bus.together():
            if self._fault:
                try:
                    self._begin(self._states[-1].position_rad)
                except RigError as error:
                    self._fault, self._blind = str(error), True
                    self._bus.close()
                    raise

    def temperatures_c(self) -> tuple[float | None, ...]:
        """The newest temperature of every joint."""
        return tuple(health.temperature_c for health in self._health) or (None,) * len(self.limits())

    def counters(self) -> Mapping[str, int]:
        """What was counted on the bus."""
        return asdict(self._bus.statistics)

    def close(self) -> None:
        """Stop, disarm and give the port back. Every servo is tried, then the first error is raised."""
        thread, self._thread = self._thread, None
        if thread is None:
            return
        self._ending.set()
        thread.join()
        try:
            with self._bus.together():
                if self._bus.is_open:  # what was lost has been told as a fault
                    try_all((self._brake, lambda: _each(self._servos, lambda servo: servo.arm(0.0))))
        finally:
            self._bus.close()

    def _begin(self, known_rad: Sequence[float] | None) -> None:
        """Find, restart where needed and prepare every servo; hold; read the first state. Raises RigError."""
        with self._bus.together():
            self._bus.open()
            self._servos = handshake(self._bus, self._settings.servos)
            for joint, servo in enumerate(self._servos):
                servo.restart_if_alert()
                servo.prepare()
                servo.count_from(None if known_rad is None else servo.settings.counts(known_rad[joint]))
            self._health = tuple(Health(servo) for servo in self._servos)
            _each(self._servos, lambda servo: servo.arm(self._settings.watchdog_s))
            self._readings = {}
            self._heard_ns = dict.fromkeys(range(len(self._servos)), self._clock.now_ns())
            self._released, self._fault, self._blind, self._deadline_ns = False, "", False, None
            self._setpoint_rad = tuple(servo.angle_rad(servo.read("Present Position")) for servo in self._servos)
            self._read_state(certain=True)

    def _read_on(self) -> None:
        """The reading thread."""
        period_ns = round(1e9 / self._settings.state_hz)
        due_ns = health_ns = self._clock.now_ns()
        joints = cycle(range(len(self._servos)))
        while not self._ending.is_set():
            try:
                with self._bus.together():
                    if not self._blind:
                        self._read_state()
                        self._check_deadline()
                        if self._clock.now_ns() >= health_ns:
                            health_ns = self._clock.now_ns() + HEALTH_NS
                            self._complain(self._health[next(joints)].look())
            except NoReply:
                pass  # the next readings show whether it stays silent
            except Exception as error:  # whatever it is, somebody must hear of it
                self._give_up(str(error) if isinstance(error, RigError) else f"reading the servos failed: {error!r}")
            due_ns = max(due_ns + period_ns, self._clock.now_ns())
            self._clock.sleep_until(due_ns)

    def _read_state(self, *, certain: bool = False) -> None:
        """Read every servo once, remember what they say if they all do, see whether all is well. Raises BusError."""
        asked_ns = self._clock.now_ns()
        alerts, complete = self._read_all(certain=certain)
        now_ns = self._clock.now_ns()
        if complete:
            request_ns = round(self._bus.request_time_s(len(self._servos)) * 1e9)
            self._remember(asked_ns + min((now_ns - asked_ns) // 2, request_ns))
        for joint in alerts:
            self._complain(self._health[joint].look())
        for joint, health in enumerate(self._health):
            self._complain(health.feel(self._readings[joint].effort, now_ns))
        for joint, heard_ns in self._heard_ns.items():
            if now_ns - heard_ns > self._settings.lost_s * 1e9:
                silent = f"{self._servos[joint].name} has not answered for {(now_ns - heard_ns) * 1e-9:.1f} s"
                self._give_up(f"{silent}: check cable and power")

    def _read_all(self, *, certain: bool = False) -> tuple[list[int], bool]:
        """The servos' newest readings: which joints have an alert, and whether all have answered. Raises BusError."""
        ids = [servo.settings.servo_id for servo in self._servos]
        read = self._bus.read_block if certain else self._bus.read_what_answers
        replies = read(ids, *self._servos[0].state_block)
        alerts = []
        for joint, servo in enumerate(self._servos):
            if (reply := replies.get(ids[joint])) is not None:
                self._heard_ns[joint] = self._clock.now_ns()
                self._readings[joint] = servo.interpret(reply.data, self._readings.get(joint))
                alerts += [joint] if reply.alert else []
        return alerts, len(replies) == len(ids)

    def _remember(self, stamp_ns: int) -> None:
        """Add a state of all joints."""
        readings = [self._readings[joint] for joint in range(len(self._servos))]
        position = tuple(s.angle_rad(reading.counts) for s, reading in zip(self._servos, readings, strict=True))
        arrived = self._away_rad(position) <= self._settings.tolerance_rad
        if not all(reading.still for reading in readings):
            self._still = 0
        elif self._still >= 0 or arrived:
            self._still = max(self._still, 0) + 1
        else:  # it has not begun to move yet
            self._still += 1
        moving = self._still < self._settings.still_reads
        if arrived and not moving:
            self._deadline_ns = None
        if not self._states or stamp_ns > self._states[-1].stamp_ns:
            self._states.append(JointState(stamp_ns, position, self._setpoint_rad, moving, self._fault))

    def _check_deadline(self) -> None:
        """A joint that has not arrived in time is a fault."""
        if self._deadline_ns is not None and self._clock.now_ns() > self._deadline_ns:
            away = np.abs(np.subtract(self._states[-1].position_rad, self._setpoint_rad))
            if away.max() <= self._settings.tolerance_rad:  # it is there, and only not long enough yet
                return
            servo = self._servos[int(np.argmax(away))]
            self._complain(
                f"{servo.name} did not arrive in time: it is {np.degrees(away.max()):.1f} deg away from its set-point: "
                "remove what blocks it, or lower max_speed_deg_s"
            )

    def _complain(self, complaint: str) -> None:
        """The first complaint is the fault: stop all joints that can be reached."""
        if complaint and not self._fault:
            self._fault = complaint + TO_CLEAR
            self._deadline_ns = None
            with suppress(BusError):  # the fault says what happened; what else fails cannot be helped from here
                self._brake()

    def _give_up(self, complaint: str) -> None:
        """Nothing can be read any more: stop what can be reached and free the port, so that it can be plugged in."""
        self._complain(complaint)
        self._blind = True
        self._bus.close()

    def _command(self, goals: Sequence[int]) -> None:
        """Give every servo its goal at the same moment and make sure that each has it.

        Raises the first BusError, all having been tried.
        """
        wanted = {servo.settings.servo_id: goal for servo, goal in zip(self._servos, goals, strict=True)}
        self._bus.write_all(wanted, self._servos[0].table["Goal Position"])
        _each(self._servos, lambda servo: servo.confirm_goal(wanted[servo.settings.servo_id]))

    def _brake(self) -> None:
        """Stop where the profile's acceleration allows, or let go. Raises the first BusError, all having been tried."""
        self._deadline_ns, self._still = None, 0
        if self._settings.release:
            _each(self._servos, Servo.release)
            self._released = True
            return
        self._read_all()
        goals = [servo.braking_goal(self._readings[joint]) for joint, servo in enumerate(self._servos)]
        self._setpoint_rad = tuple(servo.angle_rad(goal) for servo, goal in zip(self._servos, goals, strict=True))
        self._command(goals)

    def _away_rad(self, position_rad: Sequence[float]) -> float:
        return float(np.abs(np.subtract(position_rad, self._setpoint_rad)).max())

    def _check(self) -> None:
        if self._thread is None:
            raise NotConnected(f"the servos on {self._settings.port} are not connected: call connect() first")


def _each(servos: Iterable[Servo], act: Callable[[Servo], None]) -> None:
    """Do it with every servo, then raise the first error."""
    try_all(partial(act, servo) for servo in servos)
