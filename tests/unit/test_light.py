"""How much brighter a picture is: by the median of the pixels that can be compared, channel by channel."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from viewsep.messages import FloatArray
from viewsep.perception.light import FEWEST_USABLE, USABLE, gains, scaled


def by_hand(seen: FloatArray, expected: FloatArray) -> float:
    darkest, brightest = USABLE
    ratios = [
        np.float32(a) / np.float32(b)
        for a, b in zip(seen, expected, strict=True)
        if darkest <= b <= brightest and 0 < a < brightest
    ]
    return float(np.median(np.array(ratios, np.float32))) if len(ratios) >= FEWEST_USABLE else 1.0


@given(st.integers(0, 80), st.integers(0, 2**32 - 1), st.integers(1, 255))
def test_each_channels_gain_is_the_median_of_its_usable_pixels(count: int, seed: int, brightest: int) -> None:
    rng = np.random.default_rng(seed)
    seen, expected = rng.integers(0, brightest + 1, (2, count, 3)).astype(np.uint8)
    gain = gains(seen, expected)
    assert gain.dtype == np.float64
    assert gain.tolist() == [by_hand(seen[:, k], expected[:, k]) for k in range(3)]


def test_a_picture_is_scaled_back_to_what_it_was_but_for_rounding() -> None:
    picture = np.random.default_rng(3).integers(40, 160, (30, 40, 3)).astype(np.uint8)
    gain = np.array([1.5, 1.0, 0.8])
    brighter = scaled(picture, gain)
    np.testing.assert_allclose(gains(brighter.reshape(-1, 3), picture.reshape(-1, 3)), gain, rtol=0.01)
    assert np.abs(scaled(brighter, 1.0 / gain).astype(int) - picture).max() <= 1
