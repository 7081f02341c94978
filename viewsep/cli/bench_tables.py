"""Experiments as tables on the terminal."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rich.table import Column, Table

from viewsep.bench.calibration import CONFIDENCE
from viewsep.bench.report import Report
from viewsep.bench.summary import OUTCOMES
from viewsep.cli.console import results

SHOWN_FAILURES = 30


def tell_separation(report: Report) -> None:
    """One row a method, the tests against the first one, and the first one's tasks that did not go right."""
    summaries = report.summaries()
    rare = [o for o in OUTCOMES if o not in ("right", "wrong") and any(s[o] for s in summaries.values())]
    answers = Table(Column("method", no_wrap=True), "right", "95 %", "wrong", "95 %", *rare)
    costs = Table(Column("method", no_wrap=True), "looks", "travel", "p95", "x best", "pose", "compared", "step ms")
    for method, s in summaries.items():
        answers.add_row(
            method,
            f"{s['right']}/{s['n']}",
            _interval(s["right_wilson95"]),
            str(s["wrong"]),
            _interval(s["wrong_wilson95"]),
            *(str(s[outcome]) for outcome in rare),
        )
        costs.add_row(
            method,
            _number(s["looks_median"], 0),
            _number(s["travel_deg_median"], 0),
            _number(s["travel_deg_p95"], 0),
            _number(s["travel_over_optimum_median"]),
            _mean_pose_error(s),
            _number(s["comparisons_converged_median"]),
            _number(s["step_ms_median"], 2),
        )
    results.print(answers)
    results.print(costs)
    results.print(
        "medians; travel in degrees, x best: over the shortest way there was; pose: mean error in degrees, behind "
        "a stroke from the closest pose that looks the same; compared: features in one look and per candidate, once "
        "converged",
        style="dim",
    )
    _tell_unknown(summaries)
    for test in report.comparisons():
        results.print(
            f"{test['first']} right where {test['second']} is not: {test['only_first_right']}, the reverse: "
            f"{test['only_second_right']} of {test['n']} (McNemar p = {test['p_value']:.2g})",
            highlight=False,
        )
    failures = [row for row in report.of(report.methods[0]) if row["verdict"] != "right"]
    for row in failures[:SHOWN_FAILURES]:
        said = row["object"] or row["outcome"]
        results.print(f"seed {row['seed']}: {row['truth']} -> {said}", highlight=False, soft_wrap=True)
    if len(failures) > SHOWN_FAILURES:
        results.print(f"and {len(failures) - SHOWN_FAILURES} more")


def _tell_unknown(summaries: dict[str, dict[str, Any]]) -> None:
    """How well the probability of none of the candidates tells the objects that are none, where there is one."""
    ranked = {method: s for method, s in summaries.items() if s["unknown_auc"] is not None}
    if not ranked:
        return
    table = Table(Column("method", no_wrap=True), "AUC of unknown", "95 %")
    for method, s in ranked.items():
        table.add_row(method, _number(s["unknown_auc"], 3), _bounds(s["unknown_auc_bootstrap95"]))
    results.print(table)


def tell_calibration(report: Report) -> None:
    """A column per method: how well probabilities are calibrated, and what they decide."""
    summaries = report.summaries()
    table = Table("figure", *(Column(method, justify="right") for method in summaries))
    for says, told in _CALIBRATION:
        cells = [told(s) for s in summaries.values()]
        if any(cell != "-" for cell in cells):
            table.add_row(says, *cells)
    results.print(table)
    results.print(
        "in brackets 95 % intervals, bootstrap over the tasks (shares: Wilson); ECE: expected calibration error in ten "
        f"bins; decision: the first look at which a probability is {CONFIDENCE:g}",
        style="dim",
    )


def _score(key: str, digits: int = 4) -> Callable[[dict[str, Any]], str]:
    """A figure with its bootstrap interval."""

    def told(s: dict[str, Any]) -> str:
        return f"{_number(s[key], digits)} ({_bounds(s[f'{key}_bootstrap95'], digits)})" if s[key] is not None else "-"

    return told


def _share(key: str, of: str, interval: str) -> Callable[[dict[str, Any]], str]:
    """A count of others with the interval of its share."""

    def told(s: dict[str, Any]) -> str:
        return f"{s[key]}/{s[of]} ({_interval(s[interval])})" if s[of] else "-"

    return told


_CALIBRATION: tuple[tuple[str, Callable[[dict[str, Any]], str]], ...] = (
    ("tasks, looks", lambda s: f"{s['n']}, {s['looks']}"),
    ("failed", lambda s: str(s["failed"]) if s["failed"] else "-"),
    ("ECE of the leader", _score("ece")),
    ("ECE of every candidate and none", _score("ece_every")),
    ("Brier score", _score("brier")),
    ("log loss", _score("log_loss")),
    ("named right at the decision", _share("decision_right", "decision_named", "decision_right_wilson95")),
    ("mean probability there", lambda s: _number(s["decision_probability_mean"], 4)),
    ("looks until there (median)", lambda s: _number(s["decision_looks_median"], 0)),
    ("tasks decided", lambda s: f"{s['decided']}/{s['n']}"),
    ("AUC of unknown", _score("unknown_auc", 3)),
    ("unknown objects named", _share("unknown_named", "unknown_named_of", "unknown_named_wilson95")),
    (
        "known objects called unknown",
        _share("known_called_unknown", "known_called_unknown_of", "known_called_unknown_wilson95"),
    ),
)


def tell_pose(report: Report) -> None:
    """One row a method: failures, iterations, errors over all runs, comparisons."""
    headings = ("failed", "looks", "mean", "median", "p95", "<22.6", "compared", "step ms")
    table = Table(Column("method", no_wrap=True), *headings)
    for method, s in report.summaries().items():
        table.add_row(
            method,
            f"{s['failed']}/{s['n']}",
            _number(s["looks_median"], 0),
            _mean_pose_error(s),
            _number(s["pose_error_deg_median"]),
            _number(s["pose_error_deg_p95"]),
            f"{s['pose_error_under_22.6_share']:.0%}",
            _number(s["comparisons_converged_median"]),
            _number(s["step_ms_median"], 2),
        )
    results.print(table)
    results.print(
        "errors in degrees over all runs, failed ones at their last estimate, behind a stroke from the closest pose "
        "that looks the same; compared: features in one look, once converged",
        style="dim",
    )


def _mean_pose_error(s: dict[str, Any]) -> str:
    """The mean, and where objects have symmetries the one from the closest pose that looks the same."""
    error, symmetric = (_number(s[f"pose_error_{kind}_mean"]) for kind in ("deg", "symmetric_deg"))
    return error if error == symmetric else f"{error} / {symmetric}"


def _interval(interval: list[float]) -> str:
    return f"{interval[0]:.1%}-{interval[1]:.1%}".replace("%-", "-")


def _bounds(interval: list[float] | None, digits: int = 3) -> str:
    return "-" if interval is None else "-".join(f"{bound:.{digits}f}" for bound in interval)


def _number(value: Any, digits: int = 1) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
