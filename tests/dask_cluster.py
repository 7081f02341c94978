"""A Dask scheduler with two worker processes on this machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PATIENCE_S = 30.0


@contextmanager
def dask_cluster(folder: Path, importable: Path) -> Iterator[str]:
    """Its address; files go to `folder`, and the workers can import the modules of `importable`."""
    found, processes = folder / "scheduler.json", []
    environment = os.environ | {"PYTHONPATH": str(importable)}
    options = ["--scheduler-file", str(found), "--no-dashboard"]
    deadline = time.monotonic() + PATIENCE_S
    try:
        with (folder / "dask.log").open("w") as log:
            for role in (
                ["scheduler", "--host", "127.0.0.1", "--port", "0"],
                *2 * [["worker", "--nthreads", "1", "--no-nanny", "--local-directory", str(folder)]],
            ):
                command = [sys.executable, "-m", "dask", *role, *options]
                processes.append(subprocess.Popen(command, env=environment, stdout=log, stderr=log, cwd=folder))
                while role[0] == "scheduler" and not found.exists():
                    assert time.monotonic() < deadline, "the scheduler did not start"
                    time.sleep(0.05)
        yield str(json.loads(found.read_text())["address"])
    finally:
        for process in reversed(processes):  # the scheduler last: its workers wait for it
            process.terminate()
            try:
                process.wait(5.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
