"""Models are learned from all around, the same ones every time and however many are learned at once."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from seed_method import seed_config

from viewsep import __version__
from viewsep.config import Config
from viewsep.errors import BadInput
from viewsep.geometry import delaunay_edges, equidistant_sphere
from viewsep.learning import THUMBNAIL_PX, learn_object, learn_objects, names_for
from viewsep.models.library import to_bytes
from viewsep.plugins import make_descriptor

pytestmark = pytest.mark.needs_pybullet

SOURCES = ("generated:7", "generated:7:twin=face")


def learned(jobs: int, config: Config) -> dict[str, bytes]:
    """Model files by name."""
    found = learn_objects(SOURCES, names_for(SOURCES, None), 12, config, jobs)
    return {model.name: to_bytes(model) for model in found}


def test_a_model_has_equidistant_views_with_delaunay_edges_and_a_feature_each() -> None:
    (name,) = names_for(SOURCES[:1], None)
    model, descriptor = learn_object(SOURCES[0], name, 12, Config()), make_descriptor(Config().descriptor)
    np.testing.assert_array_equal(model.directions, equidistant_sphere(12))
    np.testing.assert_array_equal(model.edges, delaunay_edges(model.directions))
    assert model.edges.shape == (3 * 12 - 6, 2)
    assert model.features.shape == (12, descriptor.size)
    np.testing.assert_allclose(model.features.sum(axis=1), 1.0, atol=1e-4)
    assert len(np.unique(model.features, axis=0)) == 12
    assert model.thumbnails.shape == (12, THUMBNAIL_PX, THUMBNAIL_PX, 3)
    assert (model.name, model.descriptor) == (name, "opponent+rings")
    assert model.provenance.source == SOURCES[0]
    assert model.provenance.software == f"viewsep {__version__}"


@pytest.mark.parametrize("config", [Config(), seed_config()])
def test_learning_again_and_learning_in_parallel_give_the_same_bytes(config: Config) -> None:
    once = learned(1, config)
    assert len(once) == 2
    assert learned(1, config) == once
    assert learned(2, config) == once


def test_a_model_remembers_the_descriptor_it_was_made_with() -> None:
    model = learn_object(SOURCES[0], "box", 12, seed_config(descriptor={"options": {"distance_px": 7}}))
    assert model.descriptor_parameters == {"distance_px": 7, "gradient_step": 6}
    assert model.digest != learn_object(SOURCES[0], "box", 12, seed_config()).digest


def test_a_mesh_is_remembered_by_its_absolute_path_and_named_after_its_folder(product_mesh: Path) -> None:
    folder = str(product_mesh.parent)
    assert names_for([folder], None) == [product_mesh.parent.name]
    model = learn_object(folder, "box", 12, Config())
    assert model.provenance.source == str(product_mesh.parent.resolve())
    assert len(model.provenance.source_digest) == 64


@pytest.mark.parametrize("views", [11, 2001])
def test_too_few_or_too_many_views_are_refused(views: int) -> None:
    with pytest.raises(BadInput, match=f"--views {views}: use 12 to 2000"):
        next(learn_objects(SOURCES, names_for(SOURCES, None), views, Config()))


def test_two_objects_of_one_name_are_refused() -> None:
    with pytest.raises(BadInput, match="two of the sources would be called 'tin'"):
        next(learn_objects(SOURCES, ["tin", "tin"], 12, Config()))


def test_a_name_goes_with_one_source_and_must_be_one() -> None:
    assert names_for(SOURCES[:1], "tin") == ["tin"]
    with pytest.raises(BadInput, match="goes with one source, but 2 were given"):
        names_for(SOURCES, "tin")
    with pytest.raises(BadInput, match="cannot name an object"):
        names_for(SOURCES[:1], "../tin")


def test_both_looks_of_a_trial_fall_in_the_same_half() -> None:
    """Every other look makes the metric, the rest are kept from it: also with 48 views, of which 0.6 would be odd."""
    model = learn_object(SOURCES[0], "box", 48, seed_config())
    assert model.trials is not None
    count = len(model.trials.directions) // 2
    assert count % 2 == 0
    np.testing.assert_array_equal(model.trials.directions[:count], model.trials.directions[count:])
