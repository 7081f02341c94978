"""What a rig is made of and what is known of it, whoever built it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from viewsep.config import Config, SimConfig
from viewsep.messages import FloatArray
from viewsep.servo_rig import is_emulated
from viewsep.session import Rig
from viewsep.sim.clock import PacedClock, SimClock
from viewsep.sim.disturbances import Disturbances
from viewsep.sim.world import Scene


class PictureKind(StrEnum):
    """What the camera of a rig shows."""

    RENDERED = "rendered"
    STAGED = "staged"
    CAMERA = "a real camera's"
    PHOTOS = "photos"
    LEARNED_PHOTOS = "photos the model was learned from"


@dataclass(frozen=True, slots=True)
class BuiltRig:
    """A rig, what its pictures are, and the configuration that goes with it: the given one, with the views filled in
    where they are photos.
    """

    rig: Rig
    config: Config
    pictures: PictureKind

    @property
    def speed(self) -> float:
        """Seconds of the rig's clock per second; 0: time passes only when somebody waits."""
        clock = self.rig.clock
        if isinstance(clock, SimClock):
            return clock.speed if isinstance(clock, PacedClock) else 0.0
        return 1.0

    @property
    def described(self) -> str:
        """What moves and what sees."""
        moves = "simulated rig"
        if self.config.rig.backend == "dynamixel":
            moves = "emulated servos" if is_emulated(self.config) else f"servos on {self.config.dynamixel.port}"
        match self.pictures:
            case PictureKind.CAMERA:
                return f"{moves}, camera {self.config.v4l2.device}"
            case PictureKind.STAGED:
                return f"{moves}, staged camera"
            case PictureKind.RENDERED:
                return moves if moves == "simulated rig" else f"{moves}, simulated camera"
        return f"{moves}, {self.pictures}"


@dataclass(frozen=True, slots=True)
class SimulatedRig(BuiltRig):
    """A rig whose truth is known: the scene, and the digest of what is in its holder (empty: nothing is)."""

    scene: Scene
    object_digest: str

    def true_rotation(self, stamp_ns: int) -> FloatArray:
        """(3, 3) object -> control at a moment."""
        return self.scene.grasp_at(stamp_ns)


def clock_at(speed: float) -> SimClock:
    """Simulated time at `speed` times the wall's; 0: it passes only when somebody waits."""
    return PacedClock(speed) if speed > 0.0 else SimClock()


def disturbances_of(sim: SimConfig) -> Disturbances:
    """What goes wrong on a simulated rig."""
    return Disturbances(**sim.model_dump(exclude={"placed"}))
