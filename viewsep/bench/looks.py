"""Who is right after how many looks: interpreters and baselines see the same pictures and name a candidate after each.

Nobody chooses views here, and nobody may decline: the most probable candidate is the answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from viewsep.bench.baselines import BASELINES, Picture, exposed_sweep
from viewsep.bench.journal import Row
from viewsep.bench.methods import Method
from viewsep.bench.setup import Setup
from viewsep.bench.summary import mcnemar_p, wilson95
from viewsep.bench.tasks import SeparationTask
from viewsep.config import Config
from viewsep.messages import BoolArray, FloatArray, Percept
from viewsep.plugins import make_descriptor, make_interpreter


def looks_row(
    task: SeparationTask, methods: Sequence[Method], baselines: Sequence[str], looks: int, setup: Setup
) -> Row:
    """Whether each method names the truth after each of at most `looks` looks of a sweep: `right` by method."""
    config = methods[0].config
    held, views, pictures = exposed_sweep(task, looks, config, setup)
    scores = {method.name: _interpreted(task, views, pictures, method.config, setup) for method in methods}
    scores |= {name: BASELINES[name](task, pictures, held.config, setup) for name in baselines}
    place = task.candidates.index(task.source)
    return {
        "index": task.index,
        "seed": task.seed,
        "truth": task.truth,
        "right": {name: _ahead(told, place) for name, told in scores.items()},
    }


def _interpreted(
    task: SeparationTask, views: FloatArray, pictures: Sequence[Picture], config: Config, setup: Setup
) -> FloatArray:
    """(L, K) how an interpreter rates the candidates after each look; the lowest rating is the best."""
    descriptor = make_descriptor(config.descriptor)
    models = [setup.model(source, config) for source in task.candidates]
    interpreter = make_interpreter(config.interpreter, models, descriptor)
    state, ratings = interpreter.start(), []
    for look, (view, picture) in enumerate(zip(views, pictures, strict=True)):
        percept = Percept(look, look, descriptor.name, descriptor.describe(*picture), view)
        state, belief = interpreter.update(state, percept)
        ratings.append([candidate.rating for candidate in belief.estimate.candidates])
    return -np.array(ratings)


def _ahead(scores: FloatArray, place: int) -> list[bool]:
    """Whether candidate `place` alone has the best of the scores (L, K) after each look."""
    others = np.delete(scores, place, axis=1).max(axis=1)
    ahead: list[bool] = (scores[:, place] > others).tolist()
    return ahead


def looks_summary(rows: Sequence[Row]) -> dict[str, Any]:
    """By method, for each number of looks: `right` of `tasks` with Wilson's interval, and what differs from the first.

    `only_first` and `only_this` count tasks that only one of both has right; `p` is McNemar's exact probability of a
    difference as large or larger by chance.
    """
    main = next(iter(rows[0]["right"]))
    figures: dict[str, Any] = {}
    for name in rows[0]["right"]:
        both = [np.array([row["right"][which] for row in rows]) for which in (main, name)]
        figures[name] = [_after(first, this) for first, this in zip(*(each.T for each in both), strict=True)]
    return figures


def _after(first: BoolArray, this: BoolArray) -> dict[str, Any]:
    only_first, only_this = int((first & ~this).sum()), int((this & ~first).sum())
    right, tasks = int(this.sum()), len(this)
    return {
        "right": right,
        "tasks": tasks,
        "right_wilson95": wilson95(right, tasks),
        "only_first": only_first,
        "only_this": only_this,
        "p": mcnemar_p(only_first, only_this),
    }
