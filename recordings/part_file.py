"""A file that grows as `<name>.part`, belongs to one process only, and takes its name when it is complete."""

from __future__ import annotations

import fcntl
import os
import shutil
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

from viewsep.errors import BadInput

SUFFIX = ".part"
BUFFER_BYTES = 1 << 20  # more than a chunk: what is written goes to the disk when it is flushed


class PartFile:
    """`open()` makes the `.part` and locks it, `complete()` renames it, `drop()` leaves it as it is."""

    def __init__(self, path: Path, *, overwrite: bool) -> None:
        self.path = path
        self.part = path.with_name(path.name + SUFFIX)
        self.file: BinaryIO | None = None
        self._overwrite = overwrite

    def open(self) -> BinaryIO:
        """The empty file. Raises BadInput when it cannot be made, exists, or is being written by another process."""
        if not self.path.parent.is_dir():
            raise BadInput(f"{self.path}: the folder {self.path.parent} does not exist; create it")
        if self.path.is_dir():
            raise BadInput(f"{self.path}: is a folder; give the name of a file")
        if self.path.exists() and not self._overwrite:
            raise BadInput(f"{self.path}: exists already; choose another name or overwrite it explicitly")
        try:
            file = self.part.open("ab" if self._overwrite else "xb", buffering=BUFFER_BYTES)
        except FileExistsError as error:
            raise BadInput(self._taken()) from error
        except OSError as error:
            raise self.unwritable(error) from error
        if not lock(file):
            file.close()
            raise BadInput(f"{self.part}: is being written by another process; record under another name")
        file.truncate(0)
        self.file = file
        return file

    def sync(self) -> None:
        """Everything written so far is on the disk when this returns. May raise OSError."""
        if self.file is not None:
            self.file.flush()
            os.fsync(self.file.fileno())

    def complete(self) -> None:
        """Put it on the disk under its final name. May raise OSError, after which the `.part` is kept.

        Raises BadInput when the name has been taken meanwhile.
        """
        try:
            self.sync()
        except OSError:
            self.drop()
            raise
        try:
            if self.path.exists() and not self._overwrite:
                raise BadInput(
                    f"{self.path}: was created meanwhile; the recording is complete in {self.part}, rename it"
                )
            self.part.replace(self.path)
        finally:
            self.drop()

    def drop(self) -> None:
        """Close the file and give the lock back."""
        file, self.file = self.file, None
        if file is not None:
            with suppress(OSError):  # what could not be written has been told already
                file.close()

    def remove(self) -> None:
        """Close and delete the `.part`."""
        self.drop()
        self.part.unlink(missing_ok=True)

    def free_bytes(self) -> int:
        """What is left of the disk."""
        return shutil.disk_usage(self.path.parent).free

    def unwritable(self, error: OSError | UnicodeError) -> BadInput:
        """`error` in a sentence."""
        reason = error.strerror if isinstance(error, OSError) else error
        return BadInput(
            f"{self.path}: cannot be written ({reason}); make room and the folder writable, or move elsewhere"
        )

    def _taken(self) -> str:
        if is_being_written(self.part):
            return f"{self.part}: is being written by another process; record under another name"
        return (
            f"{self.part}: left by an unfinished recording; save what is in it with `viewsep recordings recover "
            f"{self.part}` and move it away, or record elsewhere"
        )


def lock(file: BinaryIO) -> bool:
    """Lock an open file for this process, as long as it is open; False when another one has it."""
    try:
        fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def is_being_written(part: Path) -> bool:
    """Whether some process is writing it."""
    try:
        with part.open("rb") as file:
            return not lock(file)
    except OSError:
        return False
