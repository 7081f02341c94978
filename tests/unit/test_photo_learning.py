"""Models from photos: chosen views as nodes, neighbours where photos are, and where they came from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from view_sets import ring, write_view_set

from viewsep.camera_config import CameraConfig
from viewsep.config import Config
from viewsep.errors import BadInput
from viewsep.learning import learn_objects, learn_view_set, names_for
from viewsep.models.library import to_bytes
from viewsep.plugins import make_descriptor
from viewsep.sim.view_set import read_view_set


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_view_set(tmp_path / "tin", 1, ring(*range(0, 360, 10)))


def test_every_photo_becomes_a_node_with_the_feature_of_what_the_rig_would_see(folder: Path) -> None:
    model, view_set = learn_view_set(folder, "tin", Config()), read_view_set(folder)
    np.testing.assert_array_equal(model.directions, view_set.directions)
    assert len(model.edges) == 36
    descriptor = make_descriptor(Config().descriptor)
    np.testing.assert_array_equal(model.features[7], descriptor.describe(*view_set.picture(7, 128)))
    assert (model.provenance.source, model.provenance.source_digest) == (str(folder.resolve()), view_set.digest)


def test_every_kth_or_named_photos_become_nodes(folder: Path, tmp_path: Path) -> None:
    model = learn_view_set(folder, "tin", Config(), every=4)
    np.testing.assert_array_equal(model.directions, read_view_set(folder).directions[::4])
    assert len(model.edges) == 9
    nodes = tmp_path / "nodes.txt"
    nodes.write_text("v000.png\nv001.png\nv002.png\nv003.png")
    model = learn_view_set(folder, "tin", Config(), nodes=nodes)
    np.testing.assert_array_equal(model.edges, [(0, 1), (1, 2), (2, 3)])


def test_the_camera_settles_how_large_a_photo_is_seen(folder: Path) -> None:
    small = learn_view_set(folder, "tin", Config(camera=CameraConfig(size_px=32)))
    assert small.digest != learn_view_set(folder, "tin", Config()).digest


def test_many_are_learned_at_once_and_alike(folder: Path, tmp_path: Path) -> None:
    other = write_view_set(tmp_path / "can", 2, ring(*range(0, 360, 15)))
    sources = [str(folder), str(other)]
    names = names_for(sources, None)
    assert names == ["tin", "can"]
    found = {model.name: to_bytes(model) for model in learn_objects(sources, names, None, Config(), 2, every=2)}
    for source, name in zip(sources, names, strict=True):
        assert found[name] == to_bytes(learn_view_set(Path(source), name, Config(), every=2))


def test_too_few_or_scattered_nodes_are_refused(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"tin: 2 of 36 photos as nodes are too few \(at least 3\); choose more"):
        learn_view_set(folder, "tin", Config(), every=18)
    with pytest.raises(BadInput, match="--every 0: use 1"):
        learn_view_set(folder, "tin", Config(), every=0)
    scattered = write_view_set(tmp_path / "scattered", 1, ring(0.0, 120.0, 240.0))
    with pytest.raises(BadInput, match="scattered: no two of the 3 chosen views are neighbours, so far apart do they"):
        learn_view_set(scattered, "scattered", Config())
    nodes = tmp_path / "nodes.txt"
    nodes.write_text("v000.png\nv001.png")
    with pytest.raises(BadInput, match="2 of 3 photos as nodes are too few"):
        learn_view_set(scattered, "scattered", Config(), nodes=nodes)


@pytest.mark.shared
def test_a_turntable_set_with_missing_photos_becomes_a_ring(shared: Path) -> None:
    model = learn_view_set(shared / "photos" / "coil100" / "obj032", "tin", Config(), every=4)
    assert model.directions.shape == (18, 3)
    assert model.edges.shape == (18, 2)
