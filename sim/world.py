"""The simulated rig's physics: position-controlled joints in pybullet, stepped by the simulated clock."""

from __future__ import annotations

import tempfile
from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

from viewsep.geometry import axis_rotation, random_rotation, unit
from viewsep.kinematics import RigGeometry
from viewsep.messages import FloatArray
from viewsep.sim.clock import SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.physics import load_pybullet
from viewsep.sim.urdf import EFFORT_NM, rig_urdf

STEP_NS = 4_000_000  # 250 Hz
POSITION_GAIN = 0.2
MEMORY_S = 20.0


@dataclass(frozen=True, slots=True)
class Moment:
    """The truth at one moment: motor angles, and load angles, which are those of the object's holder.

    At a `click` the load has just jumped, or is about to: encoders on it are read then as well.
    """

    stamp_ns: int
    motor_rad: tuple[float, ...]
    load_rad: tuple[float, ...]
    click: bool = False


class Scene(Protocol):
    """What SimCamera looks at: an object in the holder of a rig, and where it was in the last seconds.

    Any number of threads may use it.
    """

    geometry: RigGeometry
    clock: SimClock
    disturbances: Disturbances

    def open(self) -> None:
        """Begin; does nothing when begun already."""
        ...

    def object_rotation(self, stamp_ns: int) -> FloatArray:
        """(3, 3) object -> world at a moment: what the camera sees. Waits on the clock until that is known."""
        ...

    def grasp_at(self, stamp_ns: int) -> FloatArray:
        """(3, 3) object -> control at a moment."""
        ...

    def close(self) -> None:
        """End. Safe to call twice."""
        ...


class World(Scene, Protocol):
    """What SimMotion drives as well: joints and their memory.

    Whoever reads `moments` holds the clock's lock. `encoder_on_load` says whether the encoders see the load, or the
    motors.
    """

    moments: deque[Moment]
    setpoint_rad: tuple[float, ...]
    encoder_on_load: bool

    def drive(self, setpoint_rad: Sequence[float]) -> tuple[float, ...]:
        """Start moving to the set-points; returns those that the joints will really come to."""
        ...


def physics_known_at(stamp_ns: int) -> int:
    """When the physics has got as far as a moment: its next step."""
    return -(-stamp_ns // STEP_NS) * STEP_NS


def load_at(moments: Sequence[Moment], stamp_ns: int) -> FloatArray:
    """True load angles (n,) at a moment in memory, interpolated."""
    after = bisect_left(moments, stamp_ns, key=lambda moment: moment.stamp_ns)
    around = [moments[max(after - 1, 0)], moments[min(after, len(moments) - 1)]]
    stamps = [moment.stamp_ns for moment in around]
    loads = zip(*(moment.load_rad for moment in around), strict=True)
    return np.array([np.interp(stamp_ns, stamps, joint) for joint in loads])


class Grip:
    """How the holder holds the object: the true rotation R (3, 3), object -> control, drawn from the seed unless given.

    With `slip_deg` it slips once, about an axis drawn from the seed.
    """

    def __init__(self, seed: int, disturbances: Disturbances, rotation: FloatArray | None = None) -> None:
        rng = np.random.default_rng([seed, 1])
        self.rotation = random_rotation(rng) if rotation is None else rotation
        self._slip_axis = unit(rng.normal(size=3))
        self._disturbances = disturbances

    def rotation_at(self, stamp_ns: int) -> FloatArray:
        """(3, 3) object -> control at a moment."""
        d = self._disturbances
        if d.slip_deg and stamp_ns >= d.slip_after_s * 1e9:
            return axis_rotation(self._slip_axis, float(np.radians(d.slip_deg))) @ self.rotation
        return self.rotation


def standing(geometry: RigGeometry, seed: int) -> FloatArray:
    """R (3, 3), object -> control, of an object put upright on what the last joint turns, at an angle from the seed.

    The mesh's z axis lies along the joint's.
    """
    up, axis = np.array([0.0, 0.0, 1.0]), unit(geometry.axes[-1])
    across = np.cross(up, axis)
    tilt = float(np.arctan2(np.linalg.norm(across), up @ axis))
    upright = axis_rotation(unit(across) if across.any() else np.array([1.0, 0.0, 0.0]), tilt)
    angle = float(np.random.default_rng([seed, 1]).uniform(0.0, 2.0 * np.pi))
    return axis_rotation(axis, angle) @ upright


class SimWorld:
    """Joints from the rig's URDF, the object in the last link with an unknown grasp, and a memory of the last seconds.

    `grasp` (3, 3) is the true rotation R, object -> control; drawn from the seed unless given. Steps lie on a fixed
    grid of simulated time, so the course of events does not depend on how the clock is read.
    """

    encoder_on_load = False  # but before the play of the joints

    def __init__(
        self,
        geometry: RigGeometry,
        clock: SimClock,
        seed: int,
        disturbances: Disturbances,
        grasp: FloatArray | None = None,
    ) -> None:
        self.geometry = geometry
        self.clock = clock
        self.disturbances = disturbances
        self.grip = Grip(seed, disturbances, grasp)
        self._bullet = load_pybullet()
        self._client = -1
        self.moments: deque[Moment] = deque(maxlen=round(MEMORY_S * 1e9 / STEP_NS))

    def open(self) -> None:
        """Create the physics world; joints start at zero, or at the limit nearest to it."""
        with self.clock.lock:
            if self._client < 0:
                self._begin()

    def _begin(self) -> None:
        bullet = self._bullet
        self._client = bullet.connect(bullet.DIRECT)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "rig.urdf"
            path.write_text(rig_urdf(self.geometry), encoding="utf-8")
            self._rig = bullet.loadURDF(
                str(path), useFixedBase=True, flags=bullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=self._client
            )
        bullet.setTimeStep(STEP_NS * 1e-9, physicsClientId=self._client)
        home = self.geometry.home()
        for joint, angle in enumerate(home):
            bullet.resetJointState(self._rig, joint, angle, physicsClientId=self._client)
        now = self.clock.now_ns()
        self._next_step_ns = (now // STEP_NS + 1) * STEP_NS
        self.moments.append(Moment(now, home, home))
        self.drive(home)
        self.clock.on_advance = self._advance

    def drive(self, setpoint_rad: Sequence[float]) -> tuple[float, ...]:
        """Give every joint's position controller a set-point."""
        with self.clock.lock:
            self.setpoint_rad = tuple(float(q) for q in setpoint_rad)
            for joint, (angle, limit) in enumerate(zip(self.setpoint_rad, self.geometry.limits, strict=True)):
                self._bullet.setJointMotorControl2(
                    self._rig,
                    joint,
                    self._bullet.POSITION_CONTROL,
                    targetPosition=angle,
                    positionGain=POSITION_GAIN,
                    maxVelocity=limit.max_speed_rad_s,
                    force=EFFORT_NM,
                    physicsClientId=self._client,
                )
            return self.setpoint_rad

    def load_at(self, stamp_ns: int) -> FloatArray:
        """True load angles (n,) at a moment in memory, interpolated."""
        with self.clock.lock:
            return load_at(self.moments, stamp_ns)

    def object_rotation(self, stamp_ns: int) -> FloatArray:
        """(3, 3) object -> world at a moment: what the camera sees."""
        self.clock.sleep_until(physics_known_at(stamp_ns))
        return self.geometry.holder_rotation(self.load_at(stamp_ns).tolist()) @ self.grasp_at(stamp_ns)

    @property
    def grasp(self) -> FloatArray:
        """(3, 3) object -> control before any slip."""
        return self.grip.rotation

    def grasp_at(self, stamp_ns: int) -> FloatArray:
        """(3, 3) object -> control at a moment, the slip included."""
        return self.grip.rotation_at(stamp_ns)

    def close(self) -> None:
        """Leave pybullet. Safe to call twice."""
        with self.clock.lock:
            self.clock.on_advance = lambda _from_ns, _to_ns: None
            if self._client >= 0:
                self._bullet.disconnect(self._client)
                self._client = -1

    def _advance(self, _from_ns: int, to_ns: int) -> None:
        bullet, client = self._bullet, self._client
        play = float(np.radians(self.disturbances.backlash_deg)) / 2
        joints = range(len(self.geometry.limits))
        while self._next_step_ns <= to_ns:
            bullet.stepSimulation(physicsClientId=client)
            states = bullet.getJointStates(self._rig, joints, physicsClientId=client)
            motor = tuple(float(state[0]) for state in states)
            load = motor
            if play:  # the load follows only when the motor has taken up the play
                before = self.moments[-1].load_rad
                load = tuple(min(max(at, q - play), q + play) for at, q in zip(before, motor, strict=True))
            self.moments.append(Moment(self._next_step_ns, motor, load))
            self._next_step_ns += STEP_NS
