"""A library is a folder with one model file per object: a zip of arrays (NumPy's npz, never pickle) and a JSON header.

The header carries the schema version, the descriptor's parameters, the provenance and the digest of the content, which
is checked on reading. Files are written under a temporary name and renamed.
"""

from __future__ import annotations

import io
import json
import re
import zipfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from viewsep.errors import BadInput, BadModel
from viewsep.files import write_whole
from viewsep.models.aspect_graph import AspectGraph, Provenance, Trials

SCHEMA_VERSION = 2  # 1: without trials, still read
SUFFIX = ".viewsep"
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,99}")
_UNREADABLE = (
    ValueError,
    TypeError,  # a single array instead of an archive of them
    KeyError,
    OSError,
    EOFError,
    NotImplementedError,
    RuntimeError,
    zipfile.BadZipFile,
    zlib.error,
)
_ARRAYS = {"directions": "<f8", "edges": "<i4", "features": "<f4", "thumbnails": "|u1"}
_TRIALS = {"directions": "<f8", "features": "<f4", "disturbed": "|b1"}


def check_name(name: str) -> str:
    """`name` if it can name an object (and so its file). Raises BadInput."""
    if not NAME.fullmatch(name):
        raise BadInput(
            f"{name!r} cannot name an object: use letters, digits, '_', '-' and '.', at most 100, no leading sign"
        )
    return name


def to_bytes(model: AspectGraph) -> bytes:
    """The model file's content; equal models give equal bytes."""
    header = {
        "format": "viewsep model",
        "schema_version": 1 if model.trials is None else SCHEMA_VERSION,
        "name": model.name,
        "digest": model.digest,
        "descriptor": model.descriptor,
        "descriptor_parameters": model.descriptor_parameters,
        "provenance": {
            "source": model.provenance.source,
            "source_digest": model.provenance.source_digest,
            "software": model.provenance.software,
        },
    }
    text = np.frombuffer(json.dumps(header, sort_keys=True).encode(), np.uint8)
    arrays = {name: np.ascontiguousarray(getattr(model, name), dtype=kind) for name, kind in _ARRAYS.items()}
    if model.trials is not None:
        for name, kind in _TRIALS.items():
            arrays[f"trial_{name}"] = np.ascontiguousarray(getattr(model.trials, name), dtype=kind)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, allow_pickle=False, header=text, **arrays)
    return buffer.getvalue()


def from_bytes(data: bytes, origin: str) -> AspectGraph:
    """Read a model file's content; `origin` names it in errors. Raises BadModel."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as archive:
            arrays = {name: archive[name] for name in archive.files}
        header = json.loads(arrays.pop("header").tobytes())
    except _UNREADABLE as error:
        raise BadModel(
            f"{origin}: not a viewsep model, or damaged ({type(error).__name__}: {error}): learn the object again"
        ) from error
    _check_header(header, origin)
    _check_arrays(arrays, origin)
    model = AspectGraph(
        name=header["name"],
        descriptor=header["descriptor"],
        descriptor_parameters=header["descriptor_parameters"],
        provenance=Provenance(**header["provenance"]),
        trials=_trials(arrays, origin) if header["schema_version"] == SCHEMA_VERSION else None,
        **{name: arrays[name] for name in _ARRAYS},
    )
    if model.digest != header["digest"]:
        raise BadModel(
            f"{origin}: its content has the hash {model.digest[:12]}, but its header says {header['digest'][:12]}: "
            "the file was changed; learn the object again"
        )
    return model


def save(model: AspectGraph, library: Path) -> Path:
    """Write `library/NAME.viewsep`, making the folder; returns the path. Raises BadInput where that is impossible."""
    path = library / f"{check_name(model.name)}{SUFFIX}"
    try:
        library.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"cannot make the library {library}: {error.strerror}; choose another folder") from error
    write_whole(path, to_bytes(model), "model")
    return path


def load(path: Path) -> AspectGraph:
    """Read one model file. Raises BadModel, or BadInput when it cannot be read at all."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BadInput(f"cannot read the model {path}: {error.strerror}") from error
    model = from_bytes(data, str(path))
    if path.name != f"{model.name}{SUFFIX}":
        raise BadModel(f"{path}: holds the object {model.name!r}; rename it to {model.name}{SUFFIX}")
    return model


def load_library(library: Path, names: Sequence[str] = ()) -> list[AspectGraph]:
    """The named models in that order, or all in alphabetical order. Raises BadInput, BadModel."""
    if not library.is_dir():
        raise BadInput(f"no library at {library}: make one with `viewsep learn SOURCE... -o {library}`")
    paths = sorted(library.glob(f"*{SUFFIX}"))
    if not paths:
        raise BadInput(f"the library {library} holds no models: fill it with `viewsep learn SOURCE... -o {library}`")
    known = {path.name.removesuffix(SUFFIX): path for path in paths}
    for name in names:
        if name not in known:
            raise BadInput(f"no model {name!r} in the library {library}: it has {', '.join(known)}")
        if list(names).count(name) > 1:
            raise BadInput(f"candidate {name!r} is named twice: name each once")
    return [load(known[name]) for name in names or known]


def _trials(arrays: dict[str, Any], origin: str) -> Trials:
    """Raises BadModel where they do not fit the views."""
    for name, kind in _TRIALS.items():
        array = arrays.get(f"trial_{name}")
        if array is None or array.dtype != np.dtype(kind):
            raise BadModel(f"{origin}: array 'trial_{name}' is missing or of the wrong type: learn the object again")
    trials = Trials(**{name: arrays[f"trial_{name}"] for name in _TRIALS})
    count = len(trials.directions)
    fits = (
        trials.directions.shape == (count, 3)
        and trials.features.shape == (count, arrays["features"].shape[1])
        and trials.disturbed.shape == (count,)
        and np.isfinite(trials.features).all()
        and np.allclose(np.linalg.norm(trials.directions, axis=1), 1.0, atol=1e-6)
    )
    if not fits:
        raise BadModel(f"{origin}: its trials do not fit its views: learn the object again")
    return trials


def _check_header(header: Any, origin: str) -> None:
    if not isinstance(header, dict) or header.get("format") != "viewsep model":
        raise BadModel(f"{origin}: not a viewsep model: learn the object with `viewsep learn`")
    version = header.get("schema_version")
    if version not in (1, SCHEMA_VERSION):
        raise BadModel(
            f"{origin}: schema version {version}, but this viewsep reads {SCHEMA_VERSION}: learn the object again"
        )
    wanted = {"name": str, "digest": str, "descriptor": str, "descriptor_parameters": dict, "provenance": dict}
    for key, kind in wanted.items():
        if not isinstance(header.get(key), kind):
            raise BadModel(f"{origin}: header key {key!r} is missing or of the wrong type: learn the object again")
    if set(header["provenance"]) != {"source", "source_digest", "software"}:
        raise BadModel(f"{origin}: header key 'provenance' is incomplete: learn the object again")
    if not NAME.fullmatch(header["name"]):
        raise BadModel(f"{origin}: the object's name {header['name']!r} is not valid: learn the object again")


def _check_arrays(arrays: dict[str, Any], origin: str) -> None:
    """Shapes fit together, types are right, directions are unit vectors, edges name nodes, features are finite."""
    for name, kind in _ARRAYS.items():
        if name not in arrays or arrays[name].dtype != np.dtype(kind):
            raise BadModel(f"{origin}: array {name!r} is missing or of the wrong type: learn the object again")
    directions, edges, features = arrays["directions"], arrays["edges"], arrays["features"]
    count = len(directions)
    fits = (
        directions.shape == (count, 3)
        and edges.shape == (len(edges), 2)
        and features.ndim == 2
        and len(features) == count
        and arrays["thumbnails"].ndim == 4
        and len(arrays["thumbnails"]) == count
        and count > 0
    )
    if not fits:
        raise BadModel(f"{origin}: its arrays do not fit together: learn the object again")
    sound = (
        np.isfinite(features).all()
        and np.allclose(np.linalg.norm(directions, axis=1), 1.0, atol=1e-6)
        and (len(edges) == 0 or (edges.min() >= 0 and edges.max() < count))
    )
    if not sound:
        raise BadModel(f"{origin}: holds values that cannot be (directions, edges or features): learn the object again")
