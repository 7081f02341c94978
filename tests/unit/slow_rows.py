"""Calls for the tests of the runner, and an experiment to interrupt: `slow_rows.py RESULT JOBS COUNT [--resume]`."""

from __future__ import annotations

import json
import os
import signal
import sys
import time
from pathlib import Path
from tempfile import NamedTemporaryFile

import cv2
import numpy as np
from threadpoolctl import threadpool_info

from viewsep.bench.journal import Journal, Row
from viewsep.bench.runner import Call, Workers, run_calls
from viewsep.errors import BadMesh, ViewsepError

SECONDS = 0.15


def row(number: int, seconds: float = 0.0, trace: Path | None = None) -> Row:
    """Figures that depend on how sums are split between threads; `trace` gets a file named after number and process."""
    if trace is not None:
        with NamedTemporaryFile(prefix=f"{number}-{os.getpid()}-", dir=trace, delete=False):
            pass
    rng = np.random.default_rng(number)
    a, b = rng.normal(size=(2, 300, 300))
    picture = cv2.GaussianBlur(rng.random((400, 400), np.float32), (0, 0), 2.5)
    time.sleep(seconds)
    threads = [int(pool["num_threads"]) for pool in threadpool_info()]
    figures = [float((a @ b).sum()), float(picture.sum()), 0.1 + 0.2 * number, -0.0, float(np.nextafter(1.0, 2.0))]
    return {"number": number, "figures": figures, "threads": max([cv2.getNumThreads(), *threads]), "pair": (1, 2)}


def row_or_error(number: int, trace: Path) -> Row:
    if number == 2:
        raise BadMesh("cracker.obj: has no faces; export it again")
    return row(number, SECONDS, trace)


def row_or_bug(number: int) -> Row:
    return row(1 // number)


def row_or_death(number: int, journal: Path) -> Row:
    """The process of row 3 dies when the other three are kept."""
    while number == 3:
        if len(journal.read_bytes().splitlines()) == 4:
            os._exit(9)
        time.sleep(0.02)
    return row(number)


def main(result: Path, jobs: int, count: int, resume: bool) -> None:
    """As a command of viewsep does it."""
    trace = result.parent / "trace"
    trace.mkdir(exist_ok=True)
    journal = Journal(result, "an experiment", resume)
    calls = [Call(f"row {number}", row, (number, SECONDS, trace)) for number in range(count)]
    result.write_text(json.dumps(run_calls(calls, Workers(jobs), journal)))
    journal.remove()


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3]), "--resume" in sys.argv)
    except ViewsepError as error:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the second Ctrl-C may come as late as this on a busy computer
        print(error, file=sys.stderr)  # noqa: T201
        sys.exit(error.exit_code)
