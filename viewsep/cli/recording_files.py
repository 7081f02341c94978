"""Recordings named on the command line, of which several files may be parts of one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from viewsep.errors import BadInput, BadRecording, ViewsepError
from viewsep.recordings.reader import Recording, check_bytes, joined, read_bytes, read_recording


@dataclass(frozen=True, slots=True)
class Named:
    """A recording and the files it was read from."""

    paths: tuple[Path, ...]
    recording: Recording

    @property
    def name(self) -> str:
        """Its files, for people."""
        return ", ".join(map(str, self.paths))


def recordings_in(paths: Sequence[Path]) -> Iterator[Named]:
    """The recordings in these files one after the other; files in a row that are parts of one recording are joined.

    Raises BadRecording before the first where a file is missing or damaged, and BadInput where a part is given twice or
    away from the others.
    """
    _check_files(paths)
    read: list[tuple[Path, Recording]] = []
    seen: dict[str, Path] = {}
    for path in paths:
        recording = read_recording(path)
        session = _session(recording)
        if read and (not session or session != _session(read[-1][1])):
            yield _joined(read)
            read = []
        if session in seen and not read:
            raise BadInput(f"{path} is a part of the same recording as {seen[session]}: give its files in a row")
        if session:
            seen[session] = path
        read.append((path, recording))
    yield _joined(read)


@contextmanager
def naming(name: str) -> Iterator[None]:
    """Errors about a recording say which one."""
    try:
        yield
    except ViewsepError as error:
        raise type(error)(f"{name}: {error}") from error


def _check_files(paths: Sequence[Path]) -> None:
    """That no file is missing or damaged: the last one too, before anything is made of the first."""
    for path in paths if len(paths) > 1 else ():
        data = read_bytes(path)
        try:
            check_bytes(data)
        except BadRecording as error:
            raise BadRecording(f"{path}: {error}") from error


def _session(recording: Recording) -> str:
    """What the parts of one recording have in common, empty where the recording does not say."""
    return recording.metadata.get("session", {}).get("opened_unix_ns", "")


def _joined(read: Sequence[tuple[Path, Recording]]) -> Named:
    parts: dict[str, Path] = {}
    for path, recording in read:
        part = recording.metadata.get("session", {}).get("part", "1")
        if part in parts:
            raise BadInput(f"{path} and {parts[part]} are the same part of one recording: give one of them")
        parts[part] = path
    return Named(tuple(path for path, _ in read), joined([recording for _, recording in read]))
