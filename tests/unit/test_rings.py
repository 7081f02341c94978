"""Ring spectra and joined descriptors: what they are blind to, what they see that co-occurrence does not."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.config import PluginConfig
from viewsep.descriptors.joined import JoinedDescriptor
from viewsep.descriptors.opponent import OpponentCooccurrence
from viewsep.descriptors.rings import RingSpectra
from viewsep.errors import BadConfig, BadInput
from viewsep.interfaces import Descriptor
from viewsep.messages import Array, BoolArray
from viewsep.plugins import make_descriptor

SIDE = 96
RINGS = RingSpectra()
JOINED = JoinedDescriptor([OpponentCooccurrence(), RINGS])


def disc(seed: int) -> tuple[Array, BoolArray]:
    """A disc with six coloured stripes."""
    rng = np.random.default_rng(seed)
    colours = rng.integers(30, 200, (6, 3))
    y, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    image = colours[np.clip(((x + SIDE / 2) / SIDE * 6).astype(int), 0, 5)].astype(np.uint8)
    mask: BoolArray = x**2 + y**2 < (0.45 * SIDE) ** 2
    image[~mask] = 255
    return image, mask


def alike(a: tuple[Array, BoolArray], b: tuple[Array, BoolArray], descriptor: Descriptor) -> float:
    return float(descriptor.similarity(descriptor.describe(*a), descriptor.describe(*b)[None])[0])


@pytest.mark.parametrize("descriptor", [RINGS, JOINED], ids=lambda d: d.name)
@given(seed=st.integers(0, 20))
def test_a_feature_is_a_histogram_like_itself(descriptor: Descriptor, seed: int) -> None:
    feature = descriptor.describe(*disc(seed))
    assert feature.shape == (descriptor.size,)
    assert feature.dtype == np.float32
    assert feature.min() >= 0
    assert feature.sum() == pytest.approx(1.0, abs=1e-4)
    assert alike(disc(seed), disc(seed), descriptor) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_roll_does_not_matter(turns: int) -> None:
    image, mask = disc(1)
    assert alike((image, mask), (np.rot90(image, turns).copy(), np.rot90(mask, turns).copy()), RINGS) > 0.999


def spot(column: int) -> tuple[Array, BoolArray]:
    """A grey disc with a dark spot, `column` px right of its middle."""
    image, mask = disc(0)
    y, x = np.mgrid[:SIDE, :SIDE] - (SIDE - 1) / 2
    image[mask] = 150
    image[(x - column) ** 2 + y**2 < 8**2] = 20
    return image, mask


def test_places_matter() -> None:
    assert alike(spot(0), spot(24), OpponentCooccurrence()) > 0.999
    assert alike(spot(0), spot(24), RINGS) < 0.98


def test_what_is_not_on_the_object_does_not_matter() -> None:
    image, mask = disc(1)
    other = image.copy()
    other[~mask] = (10, 200, 30)
    np.testing.assert_allclose(RINGS.describe(other, mask), RINGS.describe(image, mask), atol=1e-6)


@pytest.mark.parametrize("light", [0.6, 0.8, 1.25])
def test_exposure_hardly_matters(light: float) -> None:
    image, mask = disc(3)
    assert alike((image, mask), (np.clip(image * light, 0, 255).astype(np.uint8), mask), RINGS) > 0.995


def test_an_empty_mask_is_refused() -> None:
    image, mask = disc(1)
    with pytest.raises(BadInput, match="too little"):
        RINGS.describe(image, np.zeros_like(mask))


def test_joined_ones_are_the_mean_of_their_parts() -> None:
    a, b = disc(4), disc(5)
    parts = [alike(a, b, part) for part in JOINED.parts]
    assert alike(a, b, JOINED) == pytest.approx(np.mean(parts), abs=1e-6)


def test_by_name_with_options_of_each_part() -> None:
    made = make_descriptor(PluginConfig(name="opponent+rings", options={"rings.frequencies": 5}))
    assert made.name == "opponent+rings"
    assert made.parameters["rings.frequencies"] == 5
    assert made.size == OpponentCooccurrence().size + RingSpectra(frequencies=5).size


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("rings+rings", {}, "twice"),
        ("rings+nothing", {}, "nothing"),
        ("opponent+rings", {"frequencies": 5}, "descriptor.options.frequencies"),
        ("opponent+rings", {"cch.distance_px": 5}, "descriptor.options.cch.distance_px"),
        ("opponent+rings", {"rings.turns": 5}, "turns"),
    ],
)
def test_what_does_not_fit_is_refused(name: str, options: dict[str, int], said: str) -> None:
    with pytest.raises(BadConfig, match=said):
        make_descriptor(PluginConfig(name=name, options=options))
