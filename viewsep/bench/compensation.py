"""What late stamps and play cost: separation tasks on a rig that has both, before and after it was calibrated."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from viewsep.assembly import make_engine
from viewsep.built_rig import SimulatedRig
from viewsep.calibration.compensation import PunctualCamera, compensated
from viewsep.calibration.latency import Interval, Timing, agreed
from viewsep.calibration.turning import measure_timing
from viewsep.config import Config
from viewsep.errors import try_all
from viewsep.geometry import rotation_angle
from viewsep.learning import learn_object
from viewsep.messages import Outcome
from viewsep.models.aspect_graph import AspectGraph
from viewsep.perception import RigPerception
from viewsep.plugins import make_descriptor
from viewsep.rigs import pace_of, simulated_rig
from viewsep.session import Session

VIEWS = 100


@dataclass(frozen=True, slots=True)
class Calibrated:
    """What calibration found of what was injected: the latency, and the play of every joint."""

    latency_s: Interval
    joints: tuple[Timing, ...]

    def in_config(self, config: Config) -> Config:
        """The configuration with it."""
        play_deg = tuple(float(np.degrees(one.play_rad.value)) for one in self.joints)
        rig = config.rig.model_copy(update={"backlash_deg": play_deg})
        camera = config.camera.model_copy(update={"latency_s": self.latency_s.value})
        return config.model_copy(update={"rig": rig, "camera": camera})


@dataclass(frozen=True, slots=True)
class Outcomes:
    """How tasks ended: how many were `right`, `wrong` or had no answer, and the pose errors of the right ones."""

    right: int
    wrong: int
    open: int
    pose_errors_rad: tuple[float, ...]


def late_rig(config: Config, source: str, seed: int, latency_s: float, backlash_deg: float) -> SimulatedRig:
    """A simulated rig with play in every joint, whose camera stamps its frames too late."""
    sim = config.sim.model_copy(update={"backlash_deg": backlash_deg})
    simulated = simulated_rig(config.model_copy(update={"sim": sim}), source, seed)
    camera = PunctualCamera(simulated.rig.camera, -latency_s)
    return replace(simulated, rig=replace(simulated.rig, camera=camera))


def calibrate(
    config: Config, seed: int, latency_s: float, backlash_deg: float, tick: Callable[[], None] = lambda: None
) -> Calibrated:
    """Calibrate such a rig with a generated box in its holder. Raises RigError, BadInput."""
    rig = late_rig(config, f"generated:{seed}", seed, latency_s, backlash_deg).rig
    rig.motion.connect()
    try:
        rig.camera.connect()
        joints = tuple(measure_timing(rig, joint, tick) for joint in range(len(rig.motion.limits())))
    finally:
        try_all((rig.motion.close, rig.camera.close))
    return Calibrated(agreed([one.latency_s for one in joints]), joints)


def look_alikes(seed: int, config: Config) -> tuple[str, list[AspectGraph]]:
    """The source of a box, and the models of it and its twin with another face."""
    source = f"generated:{seed}"
    return source, [learn_object(s, n, VIEWS, config) for s, n in ((source, "box"), (f"{source}:twin=face", "twin"))]


def outcomes(
    configs: Sequence[Config], seeds: Sequence[int], latency_s: float, backlash_deg: float
) -> Iterator[list[tuple[Outcome, bool, float]]]:
    """Of every task how it ended under each configuration: outcome, whether the name is right, pose error (radians)."""
    for seed in seeds:
        source, models = look_alikes(seed, configs[0])
        yield [_run(config, source, models, seed, latency_s, backlash_deg) for config in configs]


def summed(ended: Sequence[tuple[Outcome, bool, float]]) -> Outcomes:
    """Counts of them."""
    named = [(right, error) for outcome, right, error in ended if outcome is Outcome.IDENTIFIED]
    errors = tuple(error for right, error in named if right)
    return Outcomes(len(errors), len(named) - len(errors), len(ended) - len(named), errors)


def _run(
    config: Config, source: str, models: Sequence[AspectGraph], seed: int, latency_s: float, backlash_deg: float
) -> tuple[Outcome, bool, float]:
    simulated = late_rig(config, source, seed, latency_s, backlash_deg)
    perception = RigPerception(compensated(simulated.rig, config), make_descriptor(config.descriptor))
    with Session(simulated.rig, make_engine(config, models), perception, pace_of(config)) as session:
        result = session.run(seed)
    error = float(rotation_angle(result.rotation, simulated.true_rotation(result.stamp_ns)))
    return result.outcome, result.object == models[0].name, error
