"""What one step of the engine and one descriptor cost, on one core."""

from __future__ import annotations

from time import perf_counter

import cv2
import numpy as np

from viewsep.assembly import make_engine
from viewsep.bench.stopwatch import TimedEngine
from viewsep.config import Config
from viewsep.geometry import random_rotation
from viewsep.interfaces import Descriptor
from viewsep.learning import CAMERA_DIRECTION, learn_object
from viewsep.messages import Array, Frame
from viewsep.perception import RigPerception
from viewsep.perception.background import Background, learn_background
from viewsep.perception.figure_ground import Segmenter
from viewsep.perception.finder import ObjectFinder
from viewsep.plugins import make_descriptor
from viewsep.rigs import pace_of, simulated_rig
from viewsep.session import Session
from viewsep.sim.render import CameraOptics
from viewsep.sim.source import open_renderer
from viewsep.sim.stage import Stage, Staging
from viewsep.sim.staged_camera import EMPTY

TASKS = 6
VIEWS = 40


def measure_speed(seed: int) -> dict[str, dict[str, float]]:
    """Medians and 95th percentiles in ms: engine steps with two candidates, the descriptor, and perception."""
    config = Config()
    finding, describing = _perceptions(seed, config)
    return {
        "engine step, 2 candidates x 100 views": _summary(_engine_steps(seed, config)),
        "descriptor of a 128 x 128 view": _summary(_descriptions(seed, config)),
        "object found in 640 x 480 and cut out": _summary(finding),
        "the same with its descriptor": _summary(describing),
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


def _perceptions(seed: int, config: Config) -> tuple[list[float], list[float]]:
    """Finding the object before a captured desk in frames of 640 x 480, without and with describing it."""
    staging = Staging(seed=seed)
    stage, descriptor = Stage(staging), make_descriptor(config.descriptor)
    empty = [(stage.exposed(*EMPTY, [0.0], number * 10**8, 10**6 + number)[0], [0.0]) for number in range(4)]
    finder = ObjectFinder(Segmenter(Background(learn_background(empty))), config.camera.size_px)
    renderer = open_renderer(f"generated:{seed}", CameraOptics(staging.object_px))
    rng = np.random.default_rng(seed)
    pictures = [renderer.render(CAMERA_DIRECTION, random_rotation(rng)) for _ in range(VIEWS // 4)]
    renderer.close()
    finding, describing = [], []
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for number in range(5 * VIEWS):
            picture, mask = pictures[number // 20]  # it turns slowly, as between two looks
            image = stage.exposed(picture, mask, [0.0], number * 10**8, number)[0]
            begin = perf_counter()
            found = finder.find(Frame(number * 10**8, number, image, None), [np.pi * (number // 20)])
            finding.append(perf_counter() - begin)
            descriptor.describe(found.image, found.mask)
            describing.append(perf_counter() - begin)
    finally:
        cv2.setNumThreads(threads)
    return finding, describing


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
