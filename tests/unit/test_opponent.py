"""Soft opponent co-occurrence: what it is blind to, what it sees, and how little light moves it."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.descriptors.cch import ColourCooccurrence
from viewsep.descriptors.opponent import OpponentCooccurrence
from viewsep.errors import BadInput
from viewsep.interfaces import Descriptor
from viewsep.messages import Array, BoolArray
from viewsep.sim.disturbances import Disturbances, disturbed

SIDE = 96
OPPONENT = OpponentCooccurrence()


def picture(seed: int) -> tuple[Array, BoolArray]:
    """A round object of coloured patches on white."""
    rng = np.random.default_rng(seed)
    patches = rng.integers(30, 200, (6, 6, 3)).astype(np.uint8)
    image = cv2.resize(patches, (SIDE, SIDE), interpolation=cv2.INTER_NEAREST)
    y, x = np.mgrid[:SIDE, :SIDE] - SIDE / 2
    mask: BoolArray = x**2 + y**2 < (0.45 * SIDE) ** 2
    image[~mask] = 255
    return image, mask


def alike(a: tuple[Array, BoolArray], b: tuple[Array, BoolArray], descriptor: Descriptor = OPPONENT) -> float:
    return float(descriptor.similarity(descriptor.describe(*a), descriptor.describe(*b)[None])[0])


@given(st.integers(0, 50))
def test_a_feature_is_a_histogram(seed: int) -> None:
    feature = OPPONENT.describe(*picture(seed))
    assert feature.shape == (OPPONENT.size,)
    assert feature.dtype == np.float32
    assert feature.min() >= 0
    assert feature.sum() == pytest.approx(1.0, abs=1e-5)
    assert alike(picture(seed), picture(seed)) == pytest.approx(1.0, abs=1e-5)


def test_it_is_a_descriptor_with_its_parameters() -> None:
    assert isinstance(OPPONENT, Descriptor)
    assert OpponentCooccurrence(opponents=4).size > OPPONENT.size
    assert OPPONENT.parameters.keys() == {"smooth_px", "near_px", "far_px", "lightness", "opponents"}


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_roll_does_not_matter(turns: int) -> None:
    image, mask = picture(1)
    assert alike((image, mask), (np.rot90(image, turns).copy(), np.rot90(mask, turns).copy())) > 0.98


def test_what_is_not_on_the_object_does_not_matter() -> None:
    image, mask = picture(1)
    other = image.copy()
    other[~mask] = (10, 200, 30)
    np.testing.assert_allclose(OPPONENT.describe(other, mask), OPPONENT.describe(image, mask), atol=1e-6)


@pytest.mark.parametrize("light", [0.6, 0.8, 1.25])
def test_exposure_hardly_matters(light: float) -> None:
    image, mask = picture(2)
    other = np.clip(image * light, 0, 255).astype(np.uint8)
    assert alike((image, mask), (other, mask)) > 0.99
    assert alike((image, mask), (other, mask)) > alike((image, mask), (other, mask), ColourCooccurrence())


@pytest.mark.parametrize("seed", range(4))
def test_a_disturbed_view_is_nearer_than_another_object(seed: int) -> None:
    image, mask = picture(seed)
    strong = Disturbances(light=0.3, noise=0.05, blur_px=1.0, mask_error=0.03)
    seen = disturbed(image, mask, strong, np.random.default_rng(seed))
    assert alike((image, mask), seen) > 0.95 > alike((image, mask), picture(seed + 10))


def test_too_little_of_an_object_is_refused() -> None:
    image, mask = picture(1)
    few = np.zeros_like(mask)
    few[3:5, 3:5] = True
    for nothing in (few, np.zeros_like(mask)):
        with pytest.raises(BadInput, match="covers too little of the picture"):
            OPPONENT.describe(image, nothing)
