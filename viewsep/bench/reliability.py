"""The figures of a calibration: reliability, expected calibration error, Brier score and log loss, and the decisions.

All looks of all tasks count. Looks of one task depend on each other, so intervals are bootstraps over the tasks; only
the bins' intervals (Wilson's) take the looks for independent and are too narrow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from viewsep.bench.calibration import CONFIDENCE
from viewsep.bench.journal import Row
from viewsep.bench.resampling import interval95, resamples
from viewsep.bench.summary import summarise, wilson95
from viewsep.messages import Array, FloatArray

BINS = 10
LEAST = 1e-12  # a probability of the truth below that costs no more


@dataclass(frozen=True, eq=False, slots=True)
class Predictions:
    """Predicted probabilities (N,), whether it was so (N,) bool, and the index of the task (N,) each belongs to."""

    predicted: FloatArray
    observed: Array
    task: Array


@dataclass(frozen=True, eq=False, slots=True)
class Looks:
    """All looks of `tasks` tasks: of the `leader` (whoever is most probable), of `every` candidate and none of them.

    `brier` and `log_loss` (L,) of each look, `task` (L,) the task it belongs to.
    """

    tasks: int
    leader: Predictions
    every: Predictions
    brier: FloatArray
    log_loss: FloatArray
    task: Array


def looks_of(rows: Sequence[Row]) -> Looks:
    """The looks of one method's tasks, those without a look left out."""
    told = [row for row in rows if row["probabilities"]]
    leader, every, brier, log_loss = [], [], [], []
    for index, row in enumerate(told):
        p = np.array(row["probabilities"])
        names = [*row["candidates"], None]
        true = np.array([name == (row["truth"] if row["known"] else None) for name in names])
        best = p.argmax(axis=1)
        leader.append((p.max(axis=1), true[best], np.full(len(p), index)))
        every.append((p.ravel(), np.tile(true, len(p)), np.full(p.size, index)))
        brier.append(((p - true) ** 2).sum(axis=1))
        log_loss.append(-np.log(np.maximum(p[:, true].sum(axis=1), LEAST)))
    return Looks(
        len(told),
        _joined(leader),
        _joined(every),
        np.concatenate(brier) if brier else np.empty(0),
        np.concatenate(log_loss) if log_loss else np.empty(0),
        _joined(leader).task,
    )


def equal_width(predictions: Predictions) -> list[dict[str, Any]]:
    """The reliability in ten bins of equal width; empty ones are left out."""
    place = _bin(predictions.predicted)
    return [_reliability(predictions, np.flatnonzero(place == index)) for index in np.unique(place)]


def equal_count(predictions: Predictions) -> list[dict[str, Any]]:
    """The reliability in ten bins that hold equally many predictions, or one more."""
    order = np.argsort(predictions.predicted, kind="stable")
    return [_reliability(predictions, part) for part in np.array_split(order, BINS) if len(part)]


def calibration_summary(rows: Sequence[Row], seed: int = 0) -> dict[str, Any]:
    """The figures of one method. `ece` is the usual one of the leader, `ece_every` that over every candidate and none.

    `decided` counts the tasks in which a candidate (or none of them) became `CONFIDENCE` probable, `decision_*` tell of
    those in which a candidate did, at that look. A figure that no row has is None.
    """
    looks = looks_of(rows)
    tasks = summarise(rows)
    kept = ("n", "right", "wrong", "undecided", "unknown", "failed", "right_wilson95", "wrong_wilson95", "looks_median")
    return {
        **{key: tasks[key] for key in kept},
        "looks": len(looks.task),
        **_scores(looks, seed),
        "reliability": {
            "leader": {"equal_width": equal_width(looks.leader), "equal_count": equal_count(looks.leader)},
            "every": {"equal_width": equal_width(looks.every), "equal_count": equal_count(looks.every)},
        },
        **_decisions(rows),
        "unknown_auc": tasks["unknown_auc"],
        "unknown_auc_bootstrap95": tasks["unknown_auc_bootstrap95"],
        **_unknown(rows),
    }


def _scores(looks: Looks, seed: int) -> dict[str, Any]:
    """ECE, Brier score and log loss, each with its interval over the tasks."""
    if not looks.tasks:
        keys = ("ece", "ece_every", "brier", "log_loss")
        return dict.fromkeys([*keys, *(f"{key}_bootstrap95" for key in keys)])
    drawn = resamples(looks.tasks, np.random.default_rng([seed, 13]))
    drawn = np.vstack([np.ones((1, looks.tasks), drawn.dtype), drawn])  # first what there is
    found = {
        "ece": _calibration_errors(looks.leader, looks.tasks, drawn),
        "ece_every": _calibration_errors(looks.every, looks.tasks, drawn),
        "brier": _means(looks.brier, looks, drawn),
        "log_loss": _means(looks.log_loss, looks, drawn),
    }
    scores: dict[str, Any] = {key: float(values[0]) for key, values in found.items()}
    return scores | {f"{key}_bootstrap95": interval95(values[1:]) for key, values in found.items()}


def _calibration_errors(predictions: Predictions, tasks: int, drawn: Array) -> FloatArray:
    """(B,) the expected calibration error when each task is drawn (B, tasks) times."""
    cell = predictions.task * BINS + _bin(predictions.predicted)

    def per_task(weights: FloatArray | None) -> FloatArray:
        return np.bincount(cell, weights, tasks * BINS).reshape(tasks, BINS).astype(np.float64)

    gap = per_task(predictions.predicted) - per_task(predictions.observed.astype(np.float64))
    errors: FloatArray = np.abs(drawn @ gap).sum(axis=1) / (drawn @ per_task(None)).sum(axis=1)
    return errors


def _means(scores: FloatArray, looks: Looks, drawn: Array) -> FloatArray:
    """(B,) the mean of the looks' scores when each task is drawn (B, tasks) times."""
    sums, counts = (np.bincount(looks.task, weights, looks.tasks) for weights in (scores, None))
    means: FloatArray = (drawn @ sums) / (drawn @ counts)
    return means


def _bin(predicted: FloatArray) -> Array:
    return np.clip((predicted * BINS).astype(np.int64), 0, BINS - 1)


def _reliability(predictions: Predictions, chosen: Array) -> dict[str, Any]:
    predicted, observed = predictions.predicted[chosen], predictions.observed[chosen]
    return {
        "n": len(chosen),
        "lowest": float(predicted.min()),
        "highest": float(predicted.max()),
        "predicted": float(predicted.mean()),
        "observed": float(observed.mean()),
        "wilson95": wilson95(int(observed.sum()), len(chosen)),
    }


def _decisions(rows: Sequence[Row]) -> dict[str, Any]:
    """What a candidate's probability was at the look that would have ended the task, and whether it was right."""
    named = [row for row in rows if row["decision"] is not None and row["object"]]
    right = sum(row["known"] and row["object"] == row["truth"] for row in named)
    return {
        "confidence": CONFIDENCE,
        "decided": sum(row["decision"] is not None for row in rows),
        "decision_named": len(named),
        "decision_right": right,
        "decision_right_wilson95": wilson95(right, len(named)) if named else None,
        "decision_probability_mean": _mean([row["decision"]["probability"] for row in named]),
        "decision_looks_median": float(np.median([row["decision"]["look"] for row in named])) if named else None,
    }


def _unknown(rows: Sequence[Row]) -> dict[str, Any]:
    """Objects that are no candidate and would be named all the same; objects that are and would be called unknown."""
    unknown = [bool(row["object"]) for row in rows if not row["known"] and row["probabilities"]]
    known = [row["outcome"] == "unknown" for row in rows if row["known"] and row["probabilities"]]
    shares: dict[str, Any] = {}
    for key, told in (("unknown_named", unknown), ("known_called_unknown", known)):
        shares |= {
            key: sum(told),
            f"{key}_of": len(told),
            f"{key}_wilson95": wilson95(sum(told), len(told)) if told else None,
        }
    return shares


def _joined(parts: Sequence[tuple[FloatArray, Array, Array]]) -> Predictions:
    if not parts:
        return Predictions(np.empty(0), np.empty(0, bool), np.empty(0, np.int64))
    predicted, observed, task = (np.concatenate(each) for each in zip(*parts, strict=True))
    return Predictions(predicted, observed, task)


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None
