"""Files of what was learned from the empty rig: one .npz each, with a digest of its contents."""

from __future__ import annotations

import hashlib
import io
import zipfile
from pathlib import Path

import cv2
import numpy as np

from viewsep.errors import BadInput
from viewsep.files import write_whole
from viewsep.messages import Array
from viewsep.perception.angles import Angles
from viewsep.perception.background import BackgroundModel
from viewsep.perception.boxes import Box
from viewsep.perception.holder import Holder, still_holder

VERSION = 1
BACKGROUND, HOLDER = "background", "holder"


def save_background(model: BackgroundModel, path: Path) -> None:
    """Write the model to one file, whole or not at all. Raises BadInput."""
    box = model.moving
    arrays = {
        "still": model.still,
        "moving": np.array([] if box is None else [box.left, box.top, box.right, box.bottom], np.int64),
        "turning": model.turning,
        "joints": model.angles.joints,
        "turns": model.angles.turns,
        "noise": np.array(model.noise),
    }
    _save(BACKGROUND, arrays, path)


def load_background(path: Path) -> BackgroundModel:
    """The model in a file. Raises BadInput naming the file and what to do."""
    found = _load(BACKGROUND, ("still", "moving", "turning", "joints", "turns", "noise"), path)
    moving = Box(*(int(edge) for edge in found["moving"])) if len(found["moving"]) else None
    angles = Angles(found["joints"], found["turns"])
    return BackgroundModel(found["still"], moving, found["turning"], angles, float(found["noise"]))


def save_holder(holder: Holder, path: Path) -> None:
    """Write the masks to one file, whole or not at all. Raises BadInput."""
    arrays = {
        "shape": np.array(holder.masks.shape),
        "bits": np.packbits(holder.masks),
        "joints": holder.angles.joints,
        "turns": holder.angles.turns,
    }
    _save(HOLDER, arrays, path)


def load_holder(path: Path) -> Holder:
    """The holder in a file of `save_holder`'s, or a still one from a picture, white on black. Raises BadInput."""
    if path.suffix.lower() != ".npz":
        return still_holder(_painted(path))
    found = _load(HOLDER, ("shape", "bits", "joints", "turns"), path)
    shape = tuple(int(n) for n in found["shape"])
    masks = np.unpackbits(found["bits"], count=int(np.prod(shape))).reshape(shape).astype(bool)
    return Holder(masks, Angles(found["joints"], found["turns"]))


def _save(kind: str, arrays: dict[str, Array], path: Path) -> None:
    data = io.BytesIO()
    about = {"kind": np.array(kind), "version": np.array(VERSION), "digest": np.array(_digest(arrays))}
    np.savez_compressed(data, allow_pickle=False, **arrays, **about)
    write_whole(path, data.getvalue(), f"{kind} of the empty rig")


def _load(kind: str, names: tuple[str, ...], path: Path) -> dict[str, Array]:
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as file:
            found = {name: file[name] for name in file.files}
    except OSError as error:
        raise BadInput(f"cannot read the {kind} {path}: {error.strerror}; capture the empty rig first") from error
    except (ValueError, EOFError, zipfile.BadZipFile, KeyError, NotImplementedError) as error:
        raise BadInput(f"{path} is damaged, or no {kind} of an empty rig: capture it again") from error
    if str(found.get("kind")) != kind:
        raise BadInput(f"{path} holds no {kind} of an empty rig: name the file that was captured as one")
    if int(found["version"]) != VERSION:
        raise BadInput(f"{path} is of version {found['version']}, this viewsep reads {VERSION}: capture it again")
    if any(name not in found for name in names) or str(found["digest"]) != _digest({n: found[n] for n in names}):
        raise BadInput(f"{path} is damaged: its contents are not those that were saved; capture it again")
    return found


def _digest(arrays: dict[str, Array]) -> str:
    """Sha256 (hex) over names, types, shapes and contents."""
    h = hashlib.sha256()
    for name, array in sorted(arrays.items()):
        h.update(f"{name} {array.dtype.str} {array.shape};".encode())
        h.update(np.ascontiguousarray(array).tobytes())
    return h.hexdigest()


def _painted(path: Path) -> Array:
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise BadInput(f"cannot read the holder's mask {path}: {error.strerror}") from error
    picture = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) if len(data) else None
    if picture is None:
        raise BadInput(f"{path}: is neither a picture nor a holder's .npz; paint the holder white on black as a PNG")
    return np.asarray(picture > 127)
