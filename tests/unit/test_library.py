"""Model files come back exactly or are refused by name: damage never turns into another model."""

from __future__ import annotations

import dataclasses
import io
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from viewsep.errors import BadInput, BadModel
from viewsep.geometry import delaunay_edges, equidistant_sphere
from viewsep.messages import Array
from viewsep.models.aspect_graph import AspectGraph, Provenance
from viewsep.models.library import check_name, from_bytes, load, load_library, save, to_bytes

NODES = equidistant_sphere(20)


def model(name: str = "tin", seed: int = 0) -> AspectGraph:
    rng = np.random.default_rng(seed)
    return AspectGraph(
        name=name,
        directions=NODES,
        edges=delaunay_edges(NODES),
        features=rng.random((20, 32), np.float32),
        thumbnails=rng.integers(0, 256, (20, 6, 6, 3), np.uint8),
        descriptor="cch",
        descriptor_parameters={"distance_px": 4, "scale": 0.5, "kind": "plain"},
        provenance=Provenance("/objects/tin", "abc", "viewsep 0"),
    )


ARRAYS = ("directions", "edges", "features", "thumbnails")
DATA = to_bytes(model())


def assert_equal(a: AspectGraph, b: AspectGraph) -> None:
    for name in ARRAYS:
        one, other = getattr(a, name), getattr(b, name)
        assert one.dtype == other.dtype
        np.testing.assert_array_equal(one, other)
    assert (a.name, a.descriptor, a.descriptor_parameters) == (b.name, b.descriptor, b.descriptor_parameters)
    assert a.digest == b.digest
    for field in dataclasses.fields(Provenance):
        assert getattr(a.provenance, field.name) == getattr(b.provenance, field.name)


def test_a_model_comes_back_exactly(tmp_path: Path) -> None:
    path = save(model(), tmp_path / "new" / "library")
    assert path == tmp_path / "new" / "library" / "tin.viewsep"
    assert_equal(load(path), model())


def test_equal_models_give_equal_bytes() -> None:
    assert to_bytes(model()) == DATA
    assert to_bytes(from_bytes(DATA, "again")) == DATA
    assert to_bytes(model(seed=1)) != DATA


def changed(array: Array) -> Array:
    """One value moved by the least amount."""
    other = array.copy()
    if array.dtype.kind == "f":
        other.flat[3] = np.nextafter(other.flat[3], 2.0, dtype=array.dtype)
    else:
        other.flat[3] += 1
    return other


DECIDING: dict[str, Callable[[AspectGraph], dict[str, Any]]] = {
    "directions": lambda m: {"directions": changed(m.directions)},
    "edges": lambda m: {"edges": changed(m.edges)},
    "fewer edges": lambda m: {"edges": m.edges[:-1]},
    "features": lambda m: {"features": changed(m.features)},
    "features' shape": lambda m: {"features": m.features.reshape(40, 16)},
    "name": lambda _: {"name": "tin2"},
    "descriptor": lambda _: {"descriptor": "other"},
    "parameters": lambda m: {"descriptor_parameters": {**m.descriptor_parameters, "distance_px": 5}},
}


@pytest.mark.parametrize("change", DECIDING.values(), ids=list(DECIDING))
def test_the_digest_changes_with_all_that_decides(change: Callable[[AspectGraph], dict[str, Any]]) -> None:
    assert dataclasses.replace(model(), **change(model())).digest != model().digest


def test_the_digest_does_not_change_with_the_provenance_or_the_pictures() -> None:
    elsewhere = dataclasses.replace(model(), provenance=Provenance("/elsewhere", "abc", "viewsep 1"))
    assert elsewhere.digest == model().digest
    assert dataclasses.replace(model(), thumbnails=np.zeros((20, 1, 1, 3), np.uint8)).digest == model().digest


def loads_the_same_or_is_refused(data: bytes) -> bool:
    """True where it was refused, under its name; where it was not, the damage must mean nothing."""
    try:
        found = from_bytes(data, "shelf/tin.viewsep")
    except BadModel as error:
        return str(error).startswith("shelf/tin.viewsep: ") or pytest.fail(f"does not name the file: {error}")
    assert_equal(found, model())
    return False


def test_flipped_bytes_are_noticed_or_change_nothing() -> None:
    positions = np.linspace(0, len(DATA) - 1, 60).astype(int)
    refused = 0
    for position in positions:
        damaged = bytearray(DATA)
        damaged[position] ^= 0xFF
        refused += loads_the_same_or_is_refused(bytes(damaged))
    assert refused > 50


def test_flipped_bits_of_the_zips_own_records_are_noticed_or_change_nothing() -> None:
    directory = DATA.index(b"PK\x01\x02")
    headers = [i for i in range(len(DATA)) if DATA[i : i + 4] == b"PK\x03\x04"]
    places = [*range(directory, len(DATA), 3), *(start + i for start in headers for i in range(0, 30, 3))]
    for i, position in enumerate(places):
        damaged = bytearray(DATA)
        damaged[position] ^= 1 << (i % 8)
        loads_the_same_or_is_refused(bytes(damaged))


def test_truncated_files_are_refused() -> None:
    for length in np.linspace(0, len(DATA) - 1, 20).astype(int):
        with pytest.raises(BadModel, match=r"shelf/tin\.viewsep"):
            from_bytes(DATA[:length], "shelf/tin.viewsep")


# ---- files that were made by something else ----


def unpacked() -> tuple[dict[str, Any], dict[str, Any]]:
    """Header and arrays of the model's file."""
    with np.load(io.BytesIO(DATA)) as archive:
        arrays = {name: archive[name] for name in archive.files}
    return json.loads(arrays.pop("header").tobytes()), arrays


def packed(header: Any, arrays: dict[str, Any], *, allow_pickle: bool = False) -> bytes:
    buffer = io.BytesIO()
    text = np.frombuffer(json.dumps(header).encode(), np.uint8)
    np.savez_compressed(buffer, allow_pickle=allow_pickle, header=text, **arrays)
    return buffer.getvalue()


def test_a_file_repacked_with_the_same_content_loads() -> None:
    assert_equal(from_bytes(packed(*unpacked()), "repacked"), model())


@pytest.mark.parametrize("version", [0, 3, "1", None])
def test_another_schema_version_is_refused_and_named(version: object) -> None:
    header, arrays = unpacked()
    with pytest.raises(BadModel, match=rf"old\.viewsep: schema version {version}, but this viewsep reads 2"):
        from_bytes(packed({**header, "schema_version": version}, arrays), "old.viewsep")


@pytest.mark.parametrize("key", ["format", "schema_version", "name", "digest", "descriptor", "provenance"])
@pytest.mark.parametrize("kind", ["missing", "of another type"])
def test_a_header_that_lacks_something_is_refused(key: str, kind: str) -> None:
    header, arrays = unpacked()
    if kind == "missing":
        del header[key]
    else:
        header[key] = [7]
    with pytest.raises(BadModel, match=r"^x\.viewsep: "):
        from_bytes(packed(header, arrays), "x.viewsep")


@pytest.mark.parametrize("header", [[], "text", 3, None])
def test_a_header_that_is_no_table_is_refused(header: object) -> None:
    with pytest.raises(BadModel, match="not a viewsep model"):
        from_bytes(packed(header, unpacked()[1]), "x.viewsep")


@pytest.mark.parametrize("provenance", [{}, {"source": "a", "source_digest": "b", "software": "c", "extra": "d"}])
def test_an_incomplete_provenance_is_refused(provenance: dict[str, str]) -> None:
    header, arrays = unpacked()
    with pytest.raises(BadModel, match="provenance"):
        from_bytes(packed({**header, "provenance": provenance}, arrays), "x.viewsep")


@pytest.mark.parametrize("name", ["../tin", "", "a/b", ".tin", "tin\n"])
def test_names_that_could_leave_the_library_are_refused(name: str) -> None:
    header, arrays = unpacked()
    with pytest.raises(BadModel, match="name"):
        from_bytes(packed({**header, "name": name}, arrays), "x.viewsep")
    with pytest.raises(BadInput, match="cannot name an object"):
        check_name(name)


@pytest.mark.parametrize("array", ARRAYS)
@pytest.mark.parametrize("kind", ["missing", "of another type", "of objects", "too short"])
def test_arrays_that_do_not_belong_in_a_model_are_refused(array: str, kind: str) -> None:
    header, arrays = unpacked()
    if kind == "missing":
        del arrays[array]
    elif kind == "of another type":
        arrays[array] = arrays[array].astype(np.complex64)
    elif kind == "of objects":
        arrays[array] = arrays[array].astype(object)
    else:
        arrays[array] = arrays[array][:-1]
    with pytest.raises(BadModel, match=r"^x\.viewsep: "):
        from_bytes(packed(header, arrays, allow_pickle=kind == "of objects"), "x.viewsep")


def test_pickled_objects_are_never_run() -> None:
    class Trap:
        def __reduce__(self) -> tuple[object, tuple[str]]:
            return pytest.fail, ("the pickle was run",)

    header, arrays = unpacked()
    arrays["features"] = np.array([Trap()], dtype=object)
    with pytest.raises(BadModel):
        from_bytes(packed(header, arrays, allow_pickle=True), "x.viewsep")


IMPOSSIBLE: dict[str, dict[str, Any]] = {
    "no unit vector": {"directions": NODES * 1.01},
    "a nan direction": {"directions": np.vstack([NODES[:-1], [[np.nan, 0.0, 1.0]]])},
    "a nan feature": {"features": np.full((20, 32), np.nan, np.float32)},
    "an edge to nowhere": {"edges": np.array([[0, 20]], np.int32)},
    "an edge before the first": {"edges": np.array([[-1, 3]], np.int32)},
    "no views": {
        "directions": np.empty((0, 3)),
        "edges": np.empty((0, 2), np.int32),
        "features": np.empty((0, 32), np.float32),
        "thumbnails": np.empty((0, 1, 1, 3), np.uint8),
    },
}


@pytest.mark.parametrize("change", IMPOSSIBLE.values(), ids=list(IMPOSSIBLE))
def test_values_that_cannot_be_are_refused_even_with_the_right_digest(change: dict[str, Any]) -> None:
    with pytest.raises(BadModel, match=r"^x\.viewsep: "):
        from_bytes(to_bytes(dataclasses.replace(model(), **change)), "x.viewsep")


@pytest.mark.parametrize("data", [b"", b"PK", b"not a zip at all" * 20, b"\x93NUMPY" + bytes(100)])
def test_other_files_are_refused(data: bytes) -> None:
    with pytest.raises(BadModel, match="not a viewsep model, or damaged"):
        from_bytes(data, "x.viewsep")


def test_a_plain_array_file_is_refused() -> None:
    buffer = io.BytesIO()
    np.save(buffer, np.arange(5))
    with pytest.raises(BadModel, match=r"x\.viewsep"):
        from_bytes(buffer.getvalue(), "x.viewsep")


# ---- libraries ----


def test_a_renamed_file_is_refused_and_says_how_to_call_it(tmp_path: Path) -> None:
    path = save(model(), tmp_path).rename(tmp_path / "box.viewsep")
    with pytest.raises(BadModel, match=r"box\.viewsep: holds the object 'tin'; rename it to tin\.viewsep"):
        load(path)


def test_a_library_is_read_in_the_order_asked_for(tmp_path: Path) -> None:
    for name in ("b", "a", "c.d"):
        save(model(name), tmp_path)
    assert [m.name for m in load_library(tmp_path)] == ["a", "b", "c.d"]
    assert [m.name for m in load_library(tmp_path, ["c.d", "a"])] == ["c.d", "a"]


def test_libraries_and_names_that_are_not_there_are_named(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=f"no library at {tmp_path}/none"):
        load_library(tmp_path / "none")
    with pytest.raises(BadInput, match=f"{tmp_path} holds no models"):
        load_library(tmp_path)
    save(model("a"), tmp_path)
    save(model("b"), tmp_path)
    with pytest.raises(BadInput, match=r"no model 'x' in the library .*: it has a, b"):
        load_library(tmp_path, ["a", "x"])
    with pytest.raises(BadInput, match="candidate 'a' is named twice"):
        load_library(tmp_path, ["a", "b", "a"])
    with pytest.raises(BadInput, match=r"cannot read the model .*gone\.viewsep"):
        load(tmp_path / "gone.viewsep")


def test_a_damaged_model_in_a_library_is_named(tmp_path: Path) -> None:
    save(model("a"), tmp_path)
    path = save(model("b"), tmp_path)
    path.write_bytes(path.read_bytes()[:-40])
    with pytest.raises(BadModel, match=r"b\.viewsep"):
        load_library(tmp_path)


def test_saving_replaces_the_model_and_leaves_nothing_else(tmp_path: Path) -> None:
    save(model(seed=1), tmp_path)
    save(model(seed=2), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["tin.viewsep"]
    assert_equal(load(tmp_path / "tin.viewsep"), model(seed=2))


def test_a_write_that_breaks_off_leaves_the_old_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    save(model(seed=1), tmp_path)

    def full(self: Path, data: bytes) -> int:
        with self.open("wb") as file:
            file.write(data[:50])
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(BadInput, match="No space left on device; choose another place"):
        save(model(seed=2), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["tin.viewsep"]
    assert_equal(load(tmp_path / "tin.viewsep"), model(seed=1))


def test_a_library_that_is_a_file_cannot_be_written_to(tmp_path: Path) -> None:
    (tmp_path / "library").write_text("mine")
    with pytest.raises(BadInput, match=r"cannot (write the model|make the library)"):
        save(model(), tmp_path / "library")
    assert (tmp_path / "library").read_text() == "mine"


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_cannot_be_written_to(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(BadInput, match="Permission denied"):
        save(model(), tmp_path)
    tmp_path.chmod(0o700)
