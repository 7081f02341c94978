"""What one step of the engine and one descriptor cost, on one core."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from viewsep.assembly import make_engine
from viewsep.bench.stopwatch import TimedEngine
from viewsep.config import Config
from viewsep.geometry import random_rotation
from viewsep.interfaces import Descriptor
from viewsep.learning import CAMERA_DIRECTION, learn_object
from viewsep.messages import Array
from viewsep.perception import RigPerception
from viewsep.plugins import make_descriptor
from viewsep.rigs import pace_of, simulated_rig
from viewsep.session import Session
from viewsep.sim.render import CameraOptics
from viewsep.sim.source import open_renderer

TASKS = 6
VIEWS = 40


def measure_speed(seed: int) -> dict[str, dict[str, float]]:
    """Medians and 95th percentiles in ms: engine steps on percepts with two candidates, and the descriptor."""
    config = Config()
    return {
        "engine step, 2 candidates x 100 views": _summary(_engine_steps(seed, config)),
        "descriptor of a 128 x 128 view": _summary(_descriptions(seed, config)),
    }


def _engine_steps(seed: int, config: Config) -> list[float]:
    times: list[float] = []
    for task in range(TASKS):
        source = f"generated:{seed + task}"
        models = [learn_object(s, name, 100, config) for s, name in ((source, "a"), (f"{source}:twin=face", "b"))]
        engine = TimedEngine(make_engine(config, models))
        rig = simulated_rig(config, source, seed + task).rig
        with Session(rig, engine, RigPerception(rig, make_descriptor(config.descriptor)), pace_of(config)) as session:
            session.run(seed + task)
        times += engine.wall_s
    return times


def _descriptions(seed: int, config: Config) -> list[float]:
    descriptor = make_descriptor(config.descriptor)
    renderer = open_renderer(f"generated:{seed}", CameraOptics(128))
    rng = np.random.default_rng(seed)
    pictures = [renderer.render(CAMERA_DIRECTION, random_rotation(rng)) for _ in range(VIEWS)]
    renderer.close()
    return [_time(descriptor, image, mask) for _ in range(5) for image, mask in pictures]


def _time(descriptor: Descriptor, image: Array, mask: Array) -> float:
    begin = perf_counter()
    descriptor.describe(image, mask)
    return perf_counter() - begin


def _summary(times: list[float]) -> dict[str, float]:
    ms = 1e3 * np.array(times)
    return {
        "median_ms": float(np.median(ms)),
        "p95_ms": float(np.percentile(ms, 95)),
        "samples": float(len(ms)),
    }
