"""How accurate the path hypotheses' poses are, for every variant and alignment (section V.A).

As in the paper the object is turned in simulation, without motors: one seeded walk over the view sphere per run, seen
by all methods alike.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter, thread_time
from typing import Any, get_args

import numpy as np

from viewsep.bench.journal import Row
from viewsep.bench.methods import PATH, Method
from viewsep.bench.setup import Setup
from viewsep.bench.summary import NODE_SPACING_DEG
from viewsep.bench.symmetry import Symmetries, symmetries
from viewsep.bench.turned import TurnedObject
from viewsep.config import Config, DescriptorConfig, InterpreterConfig, geometry_of
from viewsep.errors import BadInput
from viewsep.geometry import random_rotation, rotation_angle
from viewsep.interpretation.interpreter import Alignment, Variant
from viewsep.messages import Estimate, FloatArray, Percept
from viewsep.models.aspect_graph import AspectGraph
from viewsep.planning.exploration import EXPLORATIONS, Exploration
from viewsep.planning.reachable import ReachableViews
from viewsep.plugins import make_descriptor, make_interpreter
from viewsep.sim.render import Pictures
from viewsep.sim.view_set import is_view_set

STEP_RAD = np.radians(5.0)  # what the rigs of the presets turn from one look to the next
SEED_SECTIONS = {"descriptor": DescriptorConfig(name="cch"), "interpreter": InterpreterConfig(name=PATH)}
"""What this experiment is about, unless a configuration says otherwise."""
TRACED = 100  # iterations that every run is followed for, converged or not, for the picture of the convergence


@dataclass(frozen=True, slots=True)
class PoseRun:
    """Run `index` turns the object `source`; `seed` decides its rotation, the start view and the direction."""

    index: int
    seed: int
    source: str


def pose_methods(config: Config) -> list[Method]:
    """The four variants of section IV.A-D with both alignments."""
    methods = []
    for alignment in get_args(Alignment):
        for variant in get_args(Variant):
            options = config.interpreter.options if config.interpreter.name == PATH else {}
            options = options | {"variant": variant, "alignment": alignment}
            interpreter = InterpreterConfig(name=PATH, options=options)
            methods.append(Method(f"{variant}, {alignment}", config.model_copy(update={"interpreter": interpreter})))
    return methods


def pose_rows(run: PoseRun, methods: Sequence[Method], exploration: Exploration, setup: Setup) -> Row:
    """All methods on the same percepts: `{"rows": [one row per method]}`."""
    config = methods[0].config
    model = setup.model(run.source, config)
    pictures = setup.pictures(run.source, config)
    alike = symmetries(run.source, setup)
    try:
        walk = _Walk(run, exploration, config, pictures)
        return {"rows": [_row(run, method, model, walk, alike) for method in methods]}
    finally:
        pictures.close()


class _Walk:
    """The percepts of one run, made when they are asked for and kept for the other methods."""

    def __init__(self, run: PoseRun, exploration: Exploration, config: Config, pictures: Pictures) -> None:
        rng = np.random.default_rng([run.seed, 7])
        self.rotation = random_rotation(rng)
        self._reachable = ReachableViews.of(geometry_of(config.rig))
        self._view = self._reachable.directions[rng.integers(len(self._reachable.directions))]
        self._exploration = EXPLORATIONS[exploration].start(rng, self._view, STEP_RAD)
        self._turned = TurnedObject(pictures, self.rotation, config, run.seed)
        self._percepts: list[Percept] = []

    def percept(self, index: int) -> Percept:
        """The percept of iteration `index`."""
        while len(self._percepts) <= index:
            if self._percepts:
                self._exploration, self._view = self._exploration.next_view(self._view, self._reachable)
            self._percepts.append(self._turned.percept(len(self._percepts), self._view))
        return self._percepts[index]


def _row(run: PoseRun, method: Method, model: AspectGraph, walk: _Walk, alike: Symmetries) -> Row:
    """Follow the walk until the pose has converged (the limit: `task.max_looks`), and on for the picture."""
    interpreter = make_interpreter(method.config.interpreter, [model], make_descriptor(method.config.descriptor))
    state, limit = interpreter.start(), method.config.task.max_looks
    estimates: list[Estimate] = []
    rotations: list[FloatArray] = []
    wall, cpu = [], []
    settled = -1
    while len(estimates) < (min(TRACED, limit) if settled >= 0 else limit):
        percept = walk.percept(len(estimates))
        begin, begin_cpu = perf_counter(), thread_time()
        state, belief = interpreter.update(state, percept)
        wall.append(perf_counter() - begin)
        cpu.append(thread_time() - begin_cpu)
        rotations.append(belief.rotations[0])
        if settled < 0 and belief.estimate.candidates[0].converged:
            settled = len(estimates)
        estimates.append(belief.estimate)
    errors = [float(np.degrees(rotation_angle(rotation, walk.rotation))) for rotation in rotations]
    error = errors[settled]  # of a run that never converged the last one: nothing is left out
    return {
        "index": run.index,
        "seed": run.seed,
        "method": method.name,
        "truth": model.name,
        "object": model.name,
        "outcome": "converged" if settled >= 0 else "failed",
        "verdict": "failed" if settled < 0 else "right" if error < NODE_SPACING_DEG else "wrong",
        "looks": settled + 1 if settled >= 0 else limit,
        "travel_deg": float(np.degrees(STEP_RAD)) * (settled if settled >= 0 else limit - 1),
        "pose_error_deg": error,
        "pose_error_symmetric_deg": float(np.degrees(alike.error(rotations[settled], walk.rotation))),
        "comparisons_per_look": float(np.mean([estimate.comparisons for estimate in estimates])),
        "comparisons_converged": _median([e.comparisons for e in estimates if e.candidates[0].converged]),
        "step_ms": 1e3 * float(np.median(wall)),
        "step_cpu_ms": 1e3 * float(np.median(cpu)),
        "course": _course(estimates[:TRACED], errors[:TRACED]),
    }


def _course(estimates: Sequence[Estimate], errors: Sequence[float]) -> dict[str, Any]:
    """What the pictures need of every iteration; None where the running variance is still infinite."""
    variances = [float(np.degrees(np.sqrt(estimate.candidates[0].variance))) ** 2 for estimate in estimates]
    return {
        "variance_deg2": [round(variance, 4) if np.isfinite(variance) else None for variance in variances],
        "error_deg": [round(error, 2) for error in errors],
        "comparisons": [estimate.comparisons for estimate in estimates],
    }


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def pose_runs(sources: Sequence[str], runs: int, seed: int) -> list[PoseRun]:
    """Run i turns object i mod n with seed `seed + i`. Raises BadInput for photos, which show single views only."""
    for source in sources:
        if is_view_set(Path(source)):
            raise BadInput(f"{source} holds photos, but poses are measured on any view of a mesh: name meshes")
    return [PoseRun(index, seed + index, sources[index % len(sources)]) for index in range(runs)]
