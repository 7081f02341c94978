"""Model files with trials: they come back exactly, count for the digest, and damage is refused by name."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from painted import model

from viewsep.errors import BadModel
from viewsep.models.aspect_graph import AspectGraph, Trials
from viewsep.models.library import from_bytes, load, save, to_bytes

WHOLE = model("tin", 1, noise=0.1, disturbed=0.4)
PLAIN = model("tin", 1)
TRIAL_ARRAYS = ("trial_directions", "trial_features", "trial_disturbed")


def trials_in(of: AspectGraph) -> Trials:
    assert of.trials is not None
    return of.trials


def unpacked(of: AspectGraph) -> tuple[dict[str, Any], dict[str, Any]]:
    """Header and arrays of the model's file."""
    with np.load(io.BytesIO(to_bytes(of))) as archive:
        arrays = {name: archive[name] for name in archive.files}
    return json.loads(arrays.pop("header").tobytes()), arrays


def packed(header: dict[str, Any], arrays: dict[str, Any]) -> bytes:
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer, allow_pickle=False, header=np.frombuffer(json.dumps(header).encode(), np.uint8), **arrays
    )
    return buffer.getvalue()


def test_trials_come_back_exactly(tmp_path: Path) -> None:
    found = load(save(WHOLE, tmp_path))
    for name in ("directions", "features", "disturbed"):
        array, original = getattr(trials_in(found), name), getattr(trials_in(WHOLE), name)
        assert array.dtype == original.dtype
        np.testing.assert_array_equal(array, original)
    assert found.digest == WHOLE.digest
    assert to_bytes(found) == to_bytes(WHOLE)


def test_a_model_without_trials_comes_back_without_and_in_the_schema_from_before_there_were_any(tmp_path: Path) -> None:
    assert load(save(PLAIN, tmp_path)).trials is None
    header, arrays = unpacked(PLAIN)
    assert header["schema_version"] == 1
    assert not set(TRIAL_ARRAYS) & set(arrays)
    assert unpacked(WHOLE)[0]["schema_version"] == 2


def test_a_file_of_schema_version_1_is_still_read() -> None:
    header, arrays = unpacked(PLAIN)
    found = from_bytes(packed({**header, "schema_version": 1}, arrays), "old.viewsep")
    assert found.trials is None
    assert found.digest == PLAIN.digest == header["digest"]


def test_trials_that_a_header_of_schema_version_1_hides_are_noticed() -> None:
    header, arrays = unpacked(WHOLE)
    with pytest.raises(BadModel, match=r"^old\.viewsep: its content has the hash"):
        from_bytes(packed({**header, "schema_version": 1}, arrays), "old.viewsep")


def test_no_trials_at_all_are_trials_too(tmp_path: Path) -> None:
    none = Trials(np.empty((0, 3)), np.empty((0, WHOLE.features.shape[1]), np.float32), np.empty(0, bool))
    found = load(save(replace(WHOLE, trials=none), tmp_path))
    assert len(trials_in(found).directions) == 0


def moved(array: Any) -> Any:
    other = array.copy()
    other.flat[5] = ~other.flat[5] if array.dtype == bool else np.nextafter(other.flat[5], 2.0, dtype=array.dtype)
    return other


CHANGES: dict[str, Callable[[Trials], Trials | None]] = {
    "no trials": lambda _: None,
    "directions": lambda t: replace(t, directions=moved(t.directions)),
    "features": lambda t: replace(t, features=moved(t.features)),
    "disturbed": lambda t: replace(t, disturbed=moved(t.disturbed)),
    "one less": lambda t: Trials(t.directions[1:], t.features[1:], t.disturbed[1:]),
}


@pytest.mark.parametrize("change", CHANGES.values(), ids=list(CHANGES))
def test_the_digest_changes_with_the_trials(change: Callable[[Trials], Trials | None]) -> None:
    assert replace(WHOLE, trials=change(trials_in(WHOLE))).digest != WHOLE.digest


@pytest.mark.parametrize("array", TRIAL_ARRAYS)
@pytest.mark.parametrize("kind", ["missing", "of another type"])
def test_an_array_of_the_trials_that_is_missing_or_of_another_type_is_named(array: str, kind: str) -> None:
    header, arrays = unpacked(WHOLE)
    if kind == "missing":
        del arrays[array]
    else:
        arrays[array] = arrays[array].astype(np.complex64)
    with pytest.raises(BadModel, match=rf"^x\.viewsep: array '{array}' is missing or of the wrong type"):
        from_bytes(packed(header, arrays), "x.viewsep")


UNFIT: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "too few directions": ("trial_directions", lambda a: a[:-1]),
    "directions in the plane": ("trial_directions", lambda a: a[:, :2]),
    "no unit vectors": ("trial_directions", lambda a: a * 1.01),
    "a nan direction": ("trial_directions", lambda a: np.where(np.arange(a.size).reshape(a.shape) == 4, np.nan, a)),
    "too few features": ("trial_features", lambda a: a[:-1]),
    "features of another length": ("trial_features", lambda a: a[:, :-1]),
    "flat features": ("trial_features", lambda a: a.ravel()),
    "an infinite feature": ("trial_features", lambda a: np.where(a == a.max(), np.float32(np.inf), a)),
    "too many levels": ("trial_disturbed", lambda a: np.append(a, True)),
    "levels in columns": ("trial_disturbed", lambda a: a[:, None]),
    "a single direction": ("trial_directions", lambda a: a[0]),
}


@pytest.mark.parametrize(("array", "change"), UNFIT.values(), ids=list(UNFIT))
def test_trials_that_do_not_fit_the_views_are_refused(array: str, change: Callable[[Any], Any]) -> None:
    header, arrays = unpacked(WHOLE)
    arrays[array] = change(arrays[array])
    with pytest.raises(BadModel, match=r"^x\.viewsep: its trials do not fit its views: learn the object again"):
        from_bytes(packed(header, arrays), "x.viewsep")


def test_trials_that_were_changed_are_noticed() -> None:
    header, arrays = unpacked(WHOLE)
    arrays["trial_features"] = moved(arrays["trial_features"])
    with pytest.raises(BadModel, match=r"^x\.viewsep: its content has the hash"):
        from_bytes(packed(header, arrays), "x.viewsep")


def refused(data: bytes) -> bool:
    """Whether the file was refused, under its name; where it was not, the damage must mean nothing."""
    try:
        found = from_bytes(data, "x.viewsep")
    except BadModel as error:
        return str(error).startswith("x.viewsep: ") or pytest.fail(f"does not name the file: {error}")
    assert found.digest == WHOLE.digest
    return False


def test_cut_and_flipped_files_are_refused_or_mean_the_same() -> None:
    data = to_bytes(WHOLE)
    flipped = 0
    for place in np.linspace(0, len(data) - 1, 60).astype(int):
        assert refused(data[:place])
        damaged = bytearray(data)
        damaged[place] ^= 0xFF
        flipped += refused(bytes(damaged))
    assert flipped > 50
