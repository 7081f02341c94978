"""Writing files so that nobody ever sees half of one."""

from __future__ import annotations

import shutil
from contextlib import suppress
from pathlib import Path

from viewsep.errors import BadInput


def write_whole(path: Path, data: bytes, what: str) -> None:
    """Write `data` under a temporary name and rename it to `path`, keeping its access rights.

    Raises BadInput naming `what` and the path.
    """
    partial = path.with_name(f"{path.name}.part")
    try:
        partial.write_bytes(data)
        if path.exists():
            shutil.copymode(path, partial)
        partial.replace(path)
    except OSError as error:
        with suppress(OSError):
            partial.unlink()
        raise BadInput(f"cannot write the {what} {path}: {error.strerror}; choose another place") from error
