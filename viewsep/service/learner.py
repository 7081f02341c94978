"""Learning while the service runs: in a process of its own, so that nothing else slows down."""

from __future__ import annotations

import logging
import subprocess
import sys
import threading
from pathlib import Path

from viewsep.service.requests import Code, LearnRequest, Refused

log = logging.getLogger("viewsep.service.engine")
CLOSING_S = 5.0


class Learner:
    """Runs `viewsep learn` for one source at a time. Thread-safe."""

    def __init__(self, library: Path, config_file: Path | None) -> None:
        self._library = library
        self._config_file = config_file
        self._lock = threading.Lock()
        self._source = ""
        self._fault = ""
        self._process: subprocess.Popen[str] | None = None
        self._thread: threading.Thread | None = None

    def start(self, request: LearnRequest) -> None:
        """Begin to learn. Raises Refused while something else is being learned."""
        with self._lock:
            if self._source:
                raise Refused(Code.BUSY, f"{self._source} is being learned: wait until it is done")
            if request.source.startswith("-") or request.name.startswith("-"):
                raise Refused(Code.BAD_REQUEST, "learn: source and name do not begin with '-'")
            self._source, self._fault = request.source, ""
            command = [sys.executable, "-m", "viewsep", "learn", request.source, "--output", str(self._library)]
            command += ["--jobs", "1"]
            if request.views is not None:
                command += ["--views", str(request.views)]
            if request.name:
                command += ["--name", request.name]
            if self._config_file is not None:
                command += ["--config", str(self._config_file)]
            self._process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
            )
            self._thread = threading.Thread(target=self._wait, args=(self._process,), name="viewsep learn")
            self._thread.start()

    def under_way(self) -> str:
        """The source that is being learned, empty when none is."""
        return self._source

    def faults(self) -> tuple[str, ...]:
        """Why the last one could not be learned."""
        return (self._fault,) if self._fault else ()

    def close(self) -> None:
        """End what is under way."""
        with self._lock:
            process, thread = self._process, self._thread
        if process is not None and process.poll() is None:
            process.terminate()
            try:
                process.wait(CLOSING_S)
            except subprocess.TimeoutExpired:
                process.kill()
        if thread is not None:
            thread.join()

    def _wait(self, process: subprocess.Popen[str]) -> None:
        _, said = process.communicate()
        with self._lock:
            source, self._source = self._source, ""
            if process.returncode:
                last = said.strip().splitlines()[-1:] or [f"ended with code {process.returncode}"]
                self._fault = f"{source} was not learned: {last[0].removeprefix('viewsep: ')}"
                log.error(self._fault)
            else:
                log.info("learned %s", source)
