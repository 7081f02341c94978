"""Object separation over many seeded tasks (section V.B)."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from scipy.stats import binomtest

from viewsep.config import Config
from viewsep.errors import BadInput
from viewsep.files import write_whole
from viewsep.learning import learn_object
from viewsep.models.aspect_graph import AspectGraph
from viewsep.sim.source import object_name
from viewsep.task import Task, run_task

Pair = tuple[str, str]


@dataclass(frozen=True, slots=True)
class Separations:
    """One row per task and the summary over all of them."""

    tasks: list[dict[str, Any]]
    summary: dict[str, Any]

    def write(self, path: Path) -> None:
        """Write both as JSON, under a temporary name first. Raises BadInput where that is impossible."""
        write_whole(path, json.dumps({"tasks": self.tasks, "summary": self.summary}, indent=1).encode(), "result")


def pairs_from(path: Path) -> list[Pair]:
    """Pairs of look-alikes from a CSV with columns a and b, relative to its folder. Raises BadInput."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"cannot read the pairs {path}: {error}") from error
    if not rows or not {"a", "b"} <= set(rows[0]):
        raise BadInput(f"{path}: a list of pairs needs the columns a,b and at least one row")
    pairs = []
    for line, row in enumerate(rows, start=2):
        if not row["a"] or not row["b"]:
            raise BadInput(f"{path}, line {line}: a pair needs two names, found {row['a']!r} and {row['b']!r}")
        pairs.append((str(path.parent / row["a"]), str(path.parent / row["b"])))
    return pairs


def run_separation(
    pairs: Sequence[Pair],
    runs: int,
    seed: int,
    config: Config,
    jobs: int = -1,
    on_task: Callable[[], None] = lambda: None,
) -> Separations:
    """Task i separates pair i mod n, its truth alternating from round to round, with seed `seed + i`."""
    sources = sorted({source for pair in pairs for source in pair})
    learned = joblib.Parallel(n_jobs=jobs)(
        joblib.delayed(learn_object)(source, object_name(source), 100, config) for source in sources
    )
    models = dict(zip(sources, learned, strict=True))
    calls = []
    for index in range(runs):
        pair = pairs[index % len(pairs)]
        truth = pair[index // len(pairs) % 2]
        calls.append(
            joblib.delayed(_one)([models[source] for source in pair], truth, models[truth].name, seed + index, config)
        )
    tasks = []
    for row in joblib.Parallel(n_jobs=jobs, return_as="generator")(calls):
        tasks.append(row)
        on_task()
    return Separations(tasks, summarise(tasks))


def _one(models: list[AspectGraph], source: str, truth: str, seed: int, config: Config) -> dict[str, Any]:
    row = run_task(Task(source, truth, seed), config, models).as_dict()
    return row | {"candidates": [model.name for model in models]}


def summarise(tasks: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Counts, shares with Wilson's 95 % intervals, and medians."""
    n = len(tasks)
    right = sum(task["correct"] is True for task in tasks)
    wrong = sum(task["correct"] is False for task in tasks)
    undecided = sum(task["outcome"] == "undecided" for task in tasks)
    errors = [task["pose_error_deg"] for task in tasks if task["pose_error_deg"] is not None]
    return {
        "n": n,
        "right": right,
        "wrong": wrong,
        "undecided": undecided,
        "failed": sum(task["outcome"] == "failed" for task in tasks),
        "right_share": right / n,
        "wrong_share": wrong / n,
        "right_wilson95": wilson95(right, n),
        "wrong_wilson95": wilson95(wrong, n),
        "looks_median": float(np.median([task["looks"] for task in tasks])),
        "travel_deg_median": float(np.median([task["travel_deg"] for task in tasks])),
        "pose_error_deg_mean": float(np.mean(errors)) if errors else float("nan"),
        "comparisons_per_look_median": float(
            np.median([task["comparisons"] / max(1, task["looks"]) for task in tasks])
        ),
    }


def wilson95(count: int, n: int) -> list[float]:
    """Wilson's 95 % interval of a share."""
    interval = binomtest(count, n).proportion_ci(method="wilson")
    return [float(interval.low), float(interval.high)]
