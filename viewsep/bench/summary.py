"""What a list of task rows says: shares with intervals, medians, and whether two methods differ."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest

from viewsep.bench.journal import Row
from viewsep.bench.roc import auc, auc_bootstrap95

OUTCOMES = ("right", "wrong", "undecided", "unknown", "indistinguishable", "failed")
NODE_SPACING_DEG = 22.6  # mean angle between neighbouring views of the seed's models: its benchmark of a pose (V.A)
TIMES = ("step_ms_median", "step_ms_p95", "step_cpu_ms_median")
"""The figures of a summary that differ from run to run; all others are the same whatever ran the tasks."""


def verdict(outcome: str, named: str, truth: str, known: bool, identical: bool = False) -> str:
    """One of `OUTCOMES`: the engine's outcome beside the truth.

    Naming another object is wrong; so is any name when the truth is no candidate, where `unknown` is right, and any
    name when another candidate is a copy of the truth (`identical`), where `indistinguishable` is right.
    """
    if identical:
        return {"identified": "wrong", "indistinguishable": "right"}.get(outcome, outcome)
    if outcome == "identified":
        return "right" if known and named == truth else "wrong"
    if outcome == "unknown" and not known:
        return "right"
    return outcome


def summarise(rows: Sequence[Row]) -> dict[str, Any]:
    """The figures of one method over all its rows; every row counts, failures too.

    Angles are in degrees. `pose_error_*` are over the rows whose pose can be scored, `pose_error_symmetric_*` from the
    closest pose in which the object looks as it does, `comparisons_*` counts of feature
    comparisons in one iteration and per candidate, `step_*` milliseconds of one engine step. `unknown_auc` says how
    well the final `unknown_probability` tells objects that are no candidate from those that are (1: always, 0.5: by
    chance). A figure that no row has is None.
    """
    n = len(rows)
    counts = {verdict: sum(row["verdict"] == verdict for row in rows) for verdict in OUTCOMES}
    errors, symmetric = _values(rows, "pose_error_deg"), _values(rows, "pose_error_symmetric_deg")
    probabilities = unknown_probabilities(rows)
    return {
        "n": n,
        **counts,
        "right_wilson95": wilson95(counts["right"], n),
        "wrong_wilson95": wilson95(counts["wrong"], n),
        "undecided_wilson95": wilson95(counts["undecided"], n),
        "failed_wilson95": wilson95(counts["failed"], n),
        "unknown_auc": auc(*probabilities),
        "unknown_auc_bootstrap95": auc_bootstrap95(*probabilities),
        "travel_deg_median": _of(np.median, _values(rows, "travel_deg")),
        "travel_deg_p95": _percentile95(_values(rows, "travel_deg")),
        "travel_over_optimum_median": _of(np.median, _values(rows, "travel_over_optimum")),
        "looks_median": _of(np.median, _values(rows, "looks")),
        "pose_error_deg_mean": _of(np.mean, errors),
        "pose_error_deg_median": _of(np.median, errors),
        "pose_error_deg_p95": _percentile95(errors),
        "pose_error_under_22.6_share": _of(np.mean, [float(error < NODE_SPACING_DEG) for error in errors]),
        "pose_error_symmetric_deg_mean": _of(np.mean, symmetric),
        "pose_error_symmetric_deg_median": _of(np.median, symmetric),
        "pose_error_symmetric_deg_p95": _percentile95(symmetric),
        "comparisons_median": _of(np.median, _values(rows, "comparisons_per_look")),
        "comparisons_converged_median": _of(np.median, _values(rows, "comparisons_converged")),
        "step_ms_median": _of(np.median, _values(rows, "step_ms")),
        "step_ms_p95": _percentile95(_values(rows, "step_ms")),
        "step_cpu_ms_median": _of(np.median, _values(rows, "step_cpu_ms")),
    }


def unknown_probabilities(rows: Sequence[Row]) -> tuple[list[float], list[float]]:
    """The final probability of "none of them" where the object was a candidate, and where it was not."""
    known, unknown = ([row for row in rows if row.get("known", True) is kind] for kind in (True, False))
    return _values(known, "unknown_probability"), _values(unknown, "unknown_probability")


def wilson95(count: int, n: int) -> list[float]:
    """Wilson's 95 % interval of a share."""
    interval = binomtest(count, n).proportion_ci(method="wilson")
    return [float(interval.low), float(interval.high)]


def mcnemar(a: Sequence[Row], b: Sequence[Row]) -> dict[str, Any]:
    """McNemar's exact test on the tasks two methods share: does one get right what the other does not more often?

    `p_value` is two-sided; with no task on which they differ it is 1.
    """
    right = {row["index"]: row["verdict"] == "right" for row in a}
    pairs = [(right[row["index"]], row["verdict"] == "right") for row in b if row["index"] in right]
    only_a = sum(of_a and not of_b for of_a, of_b in pairs)
    only_b = sum(of_b and not of_a for of_a, of_b in pairs)
    return {
        "n": len(pairs),
        "only_first_right": only_a,
        "only_second_right": only_b,
        "p_value": mcnemar_p(only_a, only_b),
    }


def mcnemar_p(only_a: int, only_b: int) -> float:
    """The two-sided probability that tasks which one of two methods alone gets right fall that unevenly by chance."""
    differ = only_a + only_b
    return float(binomtest(only_a, differ).pvalue) if differ else 1.0


def _values(rows: Sequence[Row], key: str) -> list[float]:
    return [float(row[key]) for row in rows if row.get(key) is not None]


def _of(statistic: Callable[[list[float]], Any], values: list[float]) -> float | None:
    return float(statistic(values)) if values else None


def _percentile95(values: list[float]) -> float | None:
    return float(np.percentile(values, 95)) if values else None
