"""What is noticed of pictures that can be used: other light, an object that was away, wrong exposure."""

from __future__ import annotations

import numpy as np
import pytest

from viewsep.messages import FloatArray
from viewsep.perception.exposure import badly_exposed, clipped, too_dark
from viewsep.perception.notices import AWAY, Watch

SECOND_NS = 1_000_000_000


def light(*factors: float) -> FloatArray:
    return np.array(factors if len(factors) == 3 else factors * 3)


def watched(*factors: float) -> Watch:
    watch = Watch()
    for factor in factors:
        watch = watch.found(light(factor))
    return watch


def test_light_that_wanders_slowly_is_no_change() -> None:
    watch = Watch()
    for factor in 1.0 + 0.3 * np.sin(np.linspace(0.0, 6.0, 80)):
        assert watch.changed(light(factor)) == ""
        watch = watch.found(light(factor))


@pytest.mark.parametrize(
    ("now", "said"),
    [
        (light(0.5), "pictures are 0.5 times as bright as before"),
        (light(1.5), "pictures are 1.5 times as bright as before"),
        (light(1.3, 1.0, 0.9), "pictures are 1.1 times as bright as before, in another colour"),
    ],
)
def test_other_light_is_said_once_and_then_it_is_as_usual(now: FloatArray, said: str) -> None:
    watch = watched(1.0, 1.02, 0.98)
    assert watch.changed(now) == f"the light has changed: {said}"
    assert watch.found(now).changed(now) == ""


def test_of_the_first_light_and_of_unknown_light_there_is_nothing_to_say() -> None:
    assert Watch().changed(light(0.2)) == ""
    assert watched(1.0).found(None).changed(light(0.2)) == ""


def test_an_object_was_away_after_some_looks_without_it() -> None:
    watch = watched(1.0)
    for k in range(AWAY):
        assert watch.was_away(9 * SECOND_NS) == ""
        watch = watch.missing((5 + k) * SECOND_NS)
    assert watch.was_away(9 * SECOND_NS) == "the object was gone for 4.0 s"
    assert watch.found(light(1.0)).was_away(10 * SECOND_NS) == ""
    assert watch.unseen(2 * SECOND_NS).was_away(9 * SECOND_NS) == "there was no picture of the object for 7.0 s"


def test_clipped_pixels_are_counted_on_the_object() -> None:
    pixels = np.full((100, 3), 120, np.uint8)
    assert clipped(pixels).problem == clipped(pixels).note == clipped(pixels[:0]).note == ""
    pixels[:30] = 255
    assert clipped(pixels).problem == "30% of the object is burnt out: lower the exposure or the gain"
    assert clipped(pixels).note == "more than 25% of the object is burnt out: lower the exposure or the gain"
    pixels[:30] = 2
    assert clipped(pixels).problem == "30% of the object is black: raise the exposure, or add light"
    pixels[:30] = (255, 255, 90)  # one channel can still tell
    assert clipped(pixels).problem == ""


def test_whole_pictures_may_be_over_exposed_or_too_dark() -> None:
    image = np.random.default_rng(1).integers(40, 220, (240, 320, 3)).astype(np.uint8)
    assert badly_exposed(image) == too_dark(image) == ""
    assert "over-exposed, 100% of it is clipped" in badly_exposed(
        np.clip(image.astype(int) * 9, 0, 255).astype(np.uint8)
    )
    assert "too dark, half of it is below" in badly_exposed(image // 12)
    assert too_dark(np.full_like(image, 255)) == ""
