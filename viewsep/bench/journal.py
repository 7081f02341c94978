"""The finished rows of an experiment, kept beside its result until that is written: what a stopped run goes on from."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from viewsep.errors import BadInput
from viewsep.files import write_whole

Row = dict[str, Any]
"""One call's figures, as JSON knows them."""


class Journal:
    """A file of JSON lines, `RESULT.partial`: the experiment's fingerprint, then a line for every finished row.

    `experiment` is a hash of everything that decides the rows. Rows of an earlier run that was stopped are taken over
    with `resume` only. Raises BadInput when there are some and `resume` is not given, when they belong to another
    experiment, and when the file is damaged or cannot be written. Half a line at the end, of a run that was killed
    while it wrote, is dropped.
    """

    def __init__(self, result: Path, experiment: str, resume: bool) -> None:
        self.path = result.with_name(f"{result.name}.partial")
        self.rows: dict[str, Row] = {}
        lines = self._lines()
        if len(lines) > 1:
            self._check(lines, experiment, resume)
            self.rows = dict(self._parsed(number, line) for number, line in enumerate(lines[1:], start=2))
            data = b"".join(lines)
        else:
            data = _line({"experiment": experiment})
        write_whole(self.path, data, "journal")

    def append(self, key: str, row: Row) -> None:
        """Keep a finished row. Raises BadInput where that is impossible."""
        try:
            with self.path.open("r+b") as file:  # a file that was taken away is not begun again without its first line
                file.seek(0, 2)
                file.write(_line({"key": key, "row": row}))
        except OSError as error:
            raise BadInput(
                f"cannot write the journal {self.path}: {error.strerror}; make room for it, then go on with --resume"
            ) from error
        self.rows[key] = row

    def remove(self) -> None:
        """The result is safely written: the journal has done its work."""
        self.path.unlink(missing_ok=True)

    def _lines(self) -> list[bytes]:
        """The file's whole lines, none where there is no file."""
        try:
            lines = self.path.read_bytes().splitlines(keepends=True)
        except FileNotFoundError:
            return []
        except OSError as error:
            raise BadInput(f"cannot read the journal {self.path}: {error.strerror}; choose another result") from error
        return lines if not lines or lines[-1].endswith(b"\n") else lines[:-1]

    def _check(self, lines: list[bytes], experiment: str, resume: bool) -> None:
        """Rows that are there must be wanted, and of this experiment."""
        kept = f"{self.path} holds {len(lines) - 1} finished tasks of"
        if self._object(1, lines[0]).get("experiment") != experiment:
            raise BadInput(
                f"{kept} another experiment (other options, objects or program): write this result to another file, "
                "or delete that one"
            )
        if not resume:
            raise BadInput(f"{kept} this experiment, which was stopped: go on with --resume, or delete the file")

    def _parsed(self, number: int, line: bytes) -> tuple[str, Row]:
        entry = self._object(number, line)
        if not isinstance(entry.get("key"), str) or not isinstance(entry.get("row"), dict):
            raise self._damaged(number)
        return entry["key"], entry["row"]

    def _object(self, number: int, line: bytes) -> dict[str, Any]:
        try:
            entry = json.loads(line)
        except ValueError as error:
            raise self._damaged(number) from error
        if not isinstance(entry, dict):
            raise self._damaged(number)
        return entry

    def _damaged(self, number: int) -> BadInput:
        return BadInput(f"{self.path}, line {number}: is damaged; delete the file and start again without --resume")


def _line(entry: dict[str, Any]) -> bytes:
    return json.dumps(entry).encode() + b"\n"
