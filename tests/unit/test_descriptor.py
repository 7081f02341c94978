"""The colour co-occurrence histogram counts what is on the object and nothing else, and descriptors are plug-ins."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import EntryPoint, EntryPoints

import numpy as np
import pytest

from viewsep import plugins
from viewsep.config import PluginConfig
from viewsep.descriptors.cch import ColourCooccurrence
from viewsep.errors import BadConfig, BadInput
from viewsep.interfaces import Descriptor
from viewsep.messages import Array, FloatArray
from viewsep.plugins import make_descriptor, names

CCH = ColourCooccurrence()


def picture(seed: int = 0, size: int = 64) -> Array:
    """Random coloured patches of 8 x 8 pixels."""
    patches = np.random.default_rng(seed).integers(0, 256, (size // 8, size // 8, 3), np.uint8)
    return patches.repeat(8, axis=0).repeat(8, axis=1)


def disc(size: int = 64) -> Array:
    y, x = np.mgrid[:size, :size] - (size - 1) / 2
    mask: Array = np.hypot(x, y) < 0.4 * size
    return mask


def blocks(feature: Array) -> tuple[Array, Array]:
    """Colour pairs (16, 16) and gradient pairs (8, 8)."""
    return feature[:256].reshape(16, 16), feature[256:].reshape(8, 8)


@pytest.mark.parametrize("seed", range(4))
def test_a_feature_is_two_symmetric_blocks_of_one_half(seed: int) -> None:
    feature = CCH.describe(picture(seed), disc())
    assert feature.shape == (320,) == (CCH.size,)
    assert feature.dtype == np.float32
    assert (feature >= 0).all()
    for block in blocks(feature):
        assert block.sum() == pytest.approx(0.5, abs=1e-5)
        np.testing.assert_array_equal(block, block.T)


def test_similarity_is_one_for_itself_symmetric_and_less_for_others() -> None:
    features = np.stack([CCH.describe(picture(seed), disc()) for seed in range(6)])
    table = np.stack([CCH.similarity(feature, features) for feature in features])
    assert table.dtype == np.float64
    np.testing.assert_allclose(np.diag(table), 1.0, atol=1e-5)
    np.testing.assert_array_equal(table, table.T)
    assert table[~np.eye(6, dtype=bool)].max() < 0.9
    assert table.min() >= 0


def test_similarity_is_the_histogram_intersection() -> None:
    similarity = CCH.similarity(np.array([0.5, 0.25, 0.25]), np.array([[0.25, 0.5, 0.25], [0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(similarity, [0.75, 0.25])


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_turned_picture_looks_the_same(quarters: int) -> None:
    image, mask = picture(), disc()
    turned = CCH.describe(np.rot90(image, quarters), np.rot90(mask, quarters))
    (similarity,) = CCH.similarity(turned, CCH.describe(image, mask)[None])
    assert similarity > 0.99


def test_pictures_need_not_lie_in_one_piece_in_memory() -> None:
    image, mask = picture(), disc()
    feature = CCH.describe(image, mask)
    strided = np.zeros((128, 128, 3), np.uint8)
    strided[::2, ::2] = image
    np.testing.assert_array_equal(CCH.describe(strided[::2, ::2], mask), feature)
    np.testing.assert_array_equal(CCH.describe(np.asfortranarray(image), np.asfortranarray(mask)), feature)


@pytest.mark.parametrize("background", [0, 255, "noise"])
def test_the_background_does_not_matter(background: int | str) -> None:
    image, mask = picture(), disc()
    other = image.copy()
    if background == "noise":
        other[~mask] = np.random.default_rng(9).integers(0, 256, other[~mask].shape, np.uint8)
    else:
        other[~mask] = background
    np.testing.assert_array_equal(CCH.describe(other, mask), CCH.describe(image, mask))


def test_blue_does_not_matter_red_and_green_do() -> None:
    image, mask = picture(), disc()
    feature = CCH.describe(image, mask)
    for channel, same in enumerate([False, False, True]):
        other = image.copy()
        other[..., channel] = 255 - other[..., channel]
        assert np.array_equal(CCH.describe(other, mask), feature) == same


def test_describing_leaves_picture_and_mask_as_they_were() -> None:
    image, mask = picture(), disc()
    before = image.tobytes(), mask.tobytes()
    CCH.describe(image, mask)
    assert (image.tobytes(), mask.tobytes()) == before


def test_without_a_mask_all_of_the_picture_counts() -> None:
    everything = np.ones((64, 64), bool)
    np.testing.assert_array_equal(CCH.describe(picture(), None), CCH.describe(picture(), everything))


@pytest.mark.parametrize("rows", [0, 3])
def test_a_picture_without_a_pair_of_pixels_on_the_object_is_refused(rows: int) -> None:
    mask = np.zeros((64, 64), bool)
    mask[30 : 30 + rows, 30:33] = True
    with pytest.raises(BadInput, match="no two pixels of it are 4 px apart"):
        CCH.describe(picture(), mask)


def test_a_plain_surface_has_one_colour_pair_and_one_gradient_pair() -> None:
    image = np.full((32, 32, 3), (200, 70, 0), np.uint8)  # red level 3 of 0..3, green level 1
    colour, gradient = blocks(CCH.describe(image, None))
    assert colour[3 * 4 + 1, 3 * 4 + 1] == pytest.approx(0.5)
    assert gradient[0, 0] == pytest.approx(0.5)


def test_two_halves_give_the_histogram_worked_out_by_hand() -> None:
    """Columns 0-15 black, 16-31 red; pairs at a distance of 4 in eight directions over half a circle."""
    image = np.zeros((32, 32, 3), np.uint8)
    image[:, 16:, 0] = 255
    colour, gradient = blocks(CCH.describe(image, None))
    counts = {(0, 0): 0, (0, 12): 0, (12, 12): 0}
    edges = {(0, 0): 0, (0, 6): 0, (6, 6): 0}  # the strong edge in red is in columns 15 and 16: class 3 * 2
    for angle in np.arange(8) * np.pi / 8:
        dy, dx = round(4 * np.sin(angle)), round(4 * np.cos(angle))
        for column in range(max(0, -dx), 32 - max(0, dx)):
            pair = sorted([12 * (column >= 16), 12 * (column + dx >= 16)])
            counts[pair[0], pair[1]] += 32 - dy
            steep = sorted([6 * (column in (15, 16)), 6 * (column + dx in (15, 16))])
            edges[steep[0], steep[1]] += 32 - dy
    total = sum(counts.values())
    for block, expected in ((colour, counts), (gradient, edges)):
        for (a, b), count in expected.items():
            share = 0.5 * count / total
            assert block[a, b] == pytest.approx(share if a == b else share / 2, abs=1e-6)
        assert np.count_nonzero(block) == 4


def test_the_distance_decides_which_pixels_are_pairs() -> None:
    stripes = np.zeros((64, 64, 3), np.uint8)
    stripes[(np.arange(64) // 4) % 2 == 0] = 255  # 4 px wide: at 8 px across them the same colour
    near, far = (blocks(ColourCooccurrence(distance_px=d).describe(stripes, None))[0][0, 15] for d in (4, 8))
    assert near != far


# ---- plug-ins ----


def test_the_descriptor_is_found_by_its_registered_name() -> None:
    assert "cch" in names("descriptor")
    made = make_descriptor(PluginConfig(name="cch", options={"distance_px": 6}))
    assert isinstance(made, Descriptor)
    assert (made.name, made.size) == ("cch", 320)
    assert made.parameters == {"distance_px": 6, "gradient_step": 6}


@pytest.mark.parametrize("options", [{"distance": 6}, {"distance_px": "far"}])
def test_wrong_options_are_refused_and_named(options: dict[str, object]) -> None:
    with pytest.raises(BadConfig, match="distance"):
        make_descriptor(PluginConfig(name="cch", options=options))


def test_an_unknown_descriptor_is_refused_and_the_known_ones_named() -> None:
    with pytest.raises(BadConfig, match="no descriptor is called 'hog': choose one of cch"):
        make_descriptor(PluginConfig(name="hog"))


@dataclass(frozen=True)
class MeanColour:
    """A descriptor as another package would bring it."""

    weight: float = 1.0

    @property
    def name(self) -> str:
        return "mean"

    @property
    def parameters(self) -> dict[str, float | int | str]:
        return {"weight": self.weight}

    @property
    def size(self) -> int:
        return 3

    def describe(self, image: Array, mask: Array | None) -> Array:
        inside = image if mask is None else image[mask]
        mean: Array = (self.weight * inside.reshape(-1, 3).mean(axis=0)).astype(np.float32)
        return mean

    def similarity(self, feature: Array, features: Array) -> FloatArray:
        similarity: FloatArray = 1.0 / (1.0 + np.linalg.norm(features - feature, axis=1).astype(np.float64))
        return similarity


def outside(value: str) -> EntryPoints:
    return EntryPoints([EntryPoint("mean", value, "viewsep.descriptors")])


def test_a_descriptor_of_another_package_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    value = f"{__name__}:MeanColour"
    monkeypatch.setattr(plugins, "entry_points", lambda group: outside(value).select(group=group))
    made = make_descriptor(PluginConfig(name="mean", options={"weight": 2}))
    assert names("descriptor") == ["mean"]
    np.testing.assert_array_equal(made.describe(np.full((4, 4, 3), 5, np.uint8), None), [10, 10, 10])
    assert made.parameters == {"weight": 2.0}


@pytest.mark.parametrize("value", ["no_such_package:Thing", f"{__name__}:NoSuchClass"])
def test_a_descriptor_that_cannot_be_loaded_is_named(value: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "entry_points", lambda group: outside(value).select(group=group))
    with pytest.raises(BadConfig, match=f"the descriptor 'mean' .{value}. cannot be loaded"):
        make_descriptor(PluginConfig(name="mean"))
