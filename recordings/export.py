"""What all exports share: folders that are whole or not there, and pictures as files."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import cv2
import numpy as np

from viewsep.errors import BadInput
from viewsep.recordings.codec import RecordedFrame

MADE_BY_EXPORTS = frozenset(
    {"images", "masks", "views.csv", "transforms.json", "sparse", "rgb", "mask", "scene_camera.json", "scene_gt.json"}
)
"""What stands in the folders of exports; only a folder with nothing else may be replaced."""


class PictureFormat(StrEnum):
    """How pictures are written: the recorded JPEG as it is, or decoded and kept without further loss."""

    JPEG = "jpeg"
    PNG = "png"


@dataclass(frozen=True, slots=True)
class Exported:
    """How many pictures (or lines of a table) were written, and what there is to say about it."""

    count: int
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Pictures:
    """Writes pictures and masks; `written` is called after each."""

    format: PictureFormat = PictureFormat.JPEG
    written: Callable[[], None] = lambda: None

    def write(self, folder: Path, stem: str, frame: RecordedFrame, *, transparent: bool = False) -> str:
        """Write the picture and return its name; a `transparent` PNG has the mask in its alpha channel.

        Raises BadRecording where it is damaged, OSError.
        """
        if self.format is PictureFormat.JPEG:
            name, data = f"{stem}.jpg", frame.jpeg
        else:
            name, data = f"{stem}.png", _png(frame, transparent)
        (folder / name).write_bytes(data)
        self.written()
        return name


def _png(frame: RecordedFrame, transparent: bool) -> bytes:
    decoded = frame.decode()
    image = cv2.cvtColor(decoded.image, cv2.COLOR_RGB2BGR)
    if transparent and decoded.mask is not None:
        image = np.dstack([image, decoded.mask.astype(np.uint8) * 255])
    return cv2.imencode(".png", image)[1].tobytes()


@contextmanager
def whole_folder(out: Path, force: bool) -> Iterator[Path]:
    """A new folder `<out>.part` to write into; it becomes `out` at the end, or is removed after any error.

    An existing `out` is replaced with `force`, but only where nothing else than an export stands in it. Raises BadInput
    naming the folder, also for errors of writing.
    """
    if out.name in ("", ".."):
        raise BadInput(f"--output {out}: give the name of a new folder")
    part = out.with_name(f"{out.name}.part")
    check_free(out, force)
    if not out.parent.is_dir():
        raise BadInput(f"{out}: the folder {out.parent} does not exist; create it")
    for folder in (out, part):
        _check_export(folder, force)
    try:
        if part.exists():
            shutil.rmtree(part)
        part.mkdir()
        yield part
        if out.exists():
            shutil.rmtree(out)
        part.replace(out)
    except OSError as error:
        raise BadInput(f"{out}: cannot be written ({error.strerror}); make room, or choose another place") from error
    finally:
        with suppress(OSError):
            shutil.rmtree(part)


def check_free(out: Path, force: bool) -> None:
    """Raise BadInput where something stands at `out` that may not be replaced."""
    if out.exists() and not force:
        raise BadInput(f"{out}: exists already; choose another name, or replace it with --force")


def _check_export(folder: Path, force: bool) -> None:
    """Raise BadInput unless there is nothing at `folder`, or an export that may be replaced."""
    if not folder.exists() and not folder.is_symlink():
        return
    if not force:
        raise BadInput(f"{folder}: is left from an export that was broken off; remove it, or replace it with --force")
    if not folder.is_dir() or folder.is_symlink():
        raise BadInput(f"{folder}: is no folder, so --force does not replace it; remove it yourself")
    others = sorted(path.name for path in folder.iterdir() if path.name not in MADE_BY_EXPORTS)
    if others:
        raise BadInput(
            f"{folder}: holds {others[0]!r}, which no export made; remove it yourself, or choose another name"
        )
