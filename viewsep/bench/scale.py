"""What a step of the engine costs with more and more candidates: generated objects, one core, a simulated sweep.

Every number of candidates is measured in a process of its own, so that its memory is its own.
"""

from __future__ import annotations

import multiprocessing
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter, thread_time
from typing import Any

import numpy as np

from viewsep.assembly import make_engine, reachable_views
from viewsep.bench.experiment import Progress
from viewsep.bench.journal import Row
from viewsep.bench.memory import resident_mb
from viewsep.bench.methods import Method
from viewsep.bench.runner import Call, Workers, one_thread, run_calls
from viewsep.bench.setup import Setup
from viewsep.bench.tasks import generated_objects
from viewsep.bench.turned import TurnedObject
from viewsep.config import Config
from viewsep.errors import ViewsepError
from viewsep.geometry import random_rotation
from viewsep.learning import learn_object
from viewsep.messages import Percept
from viewsep.models import library
from viewsep.planning.sweep import SweepPlanner
from viewsep.plugins import check_plugins
from viewsep.sim.source import object_name

Seen = tuple[str, int, list[Percept]]
"""The object's name, the seed of the run, and the percepts."""


def measure_scale(
    counts: Sequence[int],
    methods: Sequence[Method],
    setup: Setup,
    seed: int,
    runs: int,
    looks: int,
    workers: Workers,
    progress: Progress,
) -> dict[str, Any]:
    """`learning` of all objects, and `rows` with the figures of each method and number of candidates.

    The objects that are looked at, `runs` of them in turn, are among the candidates of every number. Raises
    ViewsepError when a process dies, perhaps for want of memory.
    """
    sources = generated_objects(seed, max(counts))
    with tempfile.TemporaryDirectory(prefix="viewsep-") as folder:
        calls = [Call(source, _learn, (source, methods[0].config, setup, folder)) for source in sources]
        learned = run_calls(calls, workers, None, progress("learning", len(calls)))
        truths = [sources[run % min(counts)] for run in range(runs)]
        seen = {method.name: _seen(truths, method.config, setup, seed, looks) for method in methods}
        wanted = [(method, count) for method in methods for count in counts]
        heard = progress("measuring", len(wanted))
        rows = []
        for method, count in wanted:
            row = _apart(_measure, method, sources[:count], seen[method.name], folder)
            rows.append(row)
            heard(row)
    return {"learning": _learning(learned), "rows": rows}


def _learn(source: str, config: Config, setup: Setup, folder: str) -> Row:
    """Learn an object into the library; how long that took."""
    wall, cpu = perf_counter(), thread_time()
    model = learn_object(source, object_name(source), setup.views, config, setup.cache)
    taken = {"wall_s": perf_counter() - wall, "cpu_s": thread_time() - cpu}
    library.save(model, Path(folder))
    return taken


def _learning(rows: Sequence[Row]) -> dict[str, float]:
    times = {key: np.array([row[key] for row in rows]) for key in ("wall_s", "cpu_s")}
    figures: dict[str, float] = {"objects": float(len(rows))}
    for key, values in times.items():
        figures |= {f"{key}_median": float(np.median(values)), f"{key}_p95": float(np.percentile(values, 95))}
    return figures


def _apart(function: Callable[..., Row], *arguments: Any) -> Row:
    """Call the function in a new process. Raises ViewsepError when that dies."""
    try:
        with _process() as pool:
            return pool.submit(function, *arguments).result()
    except BrokenProcessPool as error:
        raise ViewsepError(
            f"the process that measured {len(arguments[1])} candidates died, perhaps for want of memory: give smaller "
            "--counts"
        ) from error


@contextmanager
def _process() -> Iterator[ProcessPoolExecutor]:
    """One new process, ended at once when something goes wrong meanwhile."""
    pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"))
    try:
        yield pool
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _measure(method: Method, sources: Sequence[str], seen: Sequence[Seen], folder: str) -> Row:
    """One method with these candidates: build the engine, then let it interpret and plan on what is seen."""
    with one_thread():
        check_plugins(method.config)  # imports them, which is not the candidates' memory
        before = resident_mb()
        models = library.load_library(Path(folder), [object_name(source) for source in sources])
        loaded = resident_mb()
        begin = perf_counter()
        engine = make_engine(method.config, models)
        built = perf_counter() - begin
        interpreting: list[float] = []
        planning: list[float] = []
        largest, first = resident_mb(), 0
        for truth, seed, percepts in seen:
            interpretation = engine.interpreter.start()
            plan, _ = engine.planner.start(seed, percepts[0].view_direction)
            for percept in percepts:
                begin = perf_counter()
                interpretation, belief = engine.interpreter.update(interpretation, percept)
                interpreted = perf_counter()
                plan, _ = engine.planner.next_view(plan, percept.view_direction, belief)
                planning.append(perf_counter() - interpreted)
                interpreting.append(interpreted - begin)
                largest = max(largest, resident_mb())
            leader = min(belief.estimate.candidates, key=lambda candidate: candidate.rating)
            first += leader.name == truth
    return {
        "method": method.name,
        "candidates": len(sources),
        "runs": len(seen),
        "looks": len(interpreting),
        "build_s": built,
        "models_mb": loaded - before,
        "engine_mb": largest - loaded,
        **_milliseconds("interpret", interpreting),
        **_milliseconds("plan", planning),
        "first": first,
    }


def _milliseconds(what: str, times_s: Sequence[float]) -> dict[str, float]:
    ms = 1e3 * np.array(times_s)
    return {f"{what}_ms_median": float(np.median(ms)), f"{what}_ms_p95": float(np.percentile(ms, 95))}


def _seen(truths: Sequence[str], config: Config, setup: Setup, seed: int, looks: int) -> list[Seen]:
    """What is seen of each of the objects on a sweep, run after run."""
    with one_thread():
        return [
            (object_name(truth), seed + run, _swept(truth, config, setup, seed + run, looks))
            for run, truth in enumerate(truths)
        ]


def _swept(source: str, config: Config, setup: Setup, seed: int, looks: int) -> list[Percept]:
    """What is seen of an object in a random pose on a sweep through the reachable views."""
    planner = SweepPlanner([], reachable_views(config.rig))
    state, first = planner.start(seed, planner.reachable.directions[0])
    pictures = setup.pictures(source, config)
    try:
        turned = TurnedObject(pictures, random_rotation(np.random.default_rng([seed, 17])), config, seed)
        percepts: list[Percept] = []
        view = first.view_direction
        assert view is not None
        while len(percepts) < looks:
            percepts.append(turned.percept(len(percepts), view))
            state, wanted = planner.next_view(state, view, None)
            assert wanted.view_direction is not None
            view = wanted.view_direction
        return percepts
    finally:
        pictures.close()
