"""Trials: further looks at an object while it is learned, some of them made worse."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest

from viewsep.messages import Array
from viewsep.trials import Picture, made_worse, rolls, trial_directions, trials_of

SIDE = 64


@dataclass(frozen=True)
class MeanColour:
    """A descriptor that is easy to check: the mean colour on the object and how much of the picture that is."""

    name: str = "mean colour"

    @property
    def parameters(self) -> dict[str, float | int | str]:
        return {}

    @property
    def size(self) -> int:
        return 4

    def describe(self, image: Array, mask: Array | None) -> Array:
        assert mask is not None
        return np.append(image[mask].mean(axis=0), mask.mean()).astype(np.float32)

    def similarity(self, feature: Array, features: Array) -> Array:
        return np.ones(len(features))


def picture(seed: int) -> Picture:
    """A round object of coloured patches on white."""
    patches = np.random.default_rng(seed).integers(40, 180, (6, 6, 3)).astype(np.uint8)
    image = cv2.resize(patches, (SIDE, SIDE), interpolation=cv2.INTER_NEAREST)
    y, x = np.mgrid[:SIDE, :SIDE] - SIDE / 2
    mask: Array = x**2 + y**2 < (0.4 * SIDE) ** 2
    image[~mask] = 255
    return image, mask


PICTURES = [picture(k) for k in range(5)]
AT = trial_directions(5)


def test_trial_directions_are_unit_vectors_all_over_the_sphere_and_always_the_same() -> None:
    at = trial_directions(300)
    np.testing.assert_allclose(np.linalg.norm(at, axis=1), 1.0)
    assert np.linalg.norm(at.mean(axis=0)) < 0.15
    np.testing.assert_allclose(at.T @ at / 300, np.eye(3) / 3.0, atol=0.08)
    np.testing.assert_array_equal(trial_directions(300), at)


def test_rolls_are_whole_turns_at_most_and_always_the_same() -> None:
    turned = rolls(200)
    assert ((turned >= 0.0) & (turned < 2.0 * np.pi)).all()
    assert np.ptp(turned) > 6.0
    np.testing.assert_array_equal(rolls(200), turned)


@pytest.mark.parametrize("seed", range(5))
def test_made_worse_a_picture_is_another_one_that_the_seed_decides(seed: int) -> None:
    image, mask = picture(seed)
    before = image.copy(), mask.copy()
    worse, wrong = made_worse(image, mask, np.random.default_rng(seed))
    assert (worse.shape, worse.dtype) == (image.shape, image.dtype)
    assert (wrong.shape, wrong.dtype) == (mask.shape, mask.dtype)
    np.testing.assert_array_equal(image, before[0])  # what it is made from stays
    np.testing.assert_array_equal(mask, before[1])
    assert (worse != image).mean() > 0.3
    again, wrong_again = made_worse(image, mask, np.random.default_rng(seed))
    np.testing.assert_array_equal(worse, again)
    np.testing.assert_array_equal(wrong, wrong_again)
    other, _ = made_worse(image, mask, np.random.default_rng(seed + 100))
    assert (worse != other).mean() > 0.3
    assert 0.7 < (mask & wrong).sum() / (mask | wrong).sum() <= 1.0


def test_some_pictures_become_lighter_and_some_darker_and_masks_wrong() -> None:
    image, mask = PICTURES[0]
    made = [made_worse(image, mask, np.random.default_rng(seed)) for seed in range(30)]
    lightness = np.array([worse[mask].mean() for worse, _ in made]) / image[mask].mean()
    assert lightness.min() < 0.8
    assert lightness.max() > 1.2
    assert np.mean([(wrong != mask).any() for _, wrong in made]) > 0.5
    tints = np.array([worse[mask].mean(axis=0) / worse[mask].mean() for worse, _ in made])
    assert tints.std(axis=0).min() > 0.01  # the white balance differs, too


def test_between_the_views_trials_are_the_pictures_and_the_same_made_worse() -> None:
    trials = trials_of(AT, PICTURES, MeanColour())
    np.testing.assert_array_equal(trials.disturbed, np.arange(10) >= 5)
    np.testing.assert_array_equal(trials.directions, np.concatenate([AT, AT]))
    clean = np.stack([MeanColour().describe(*one) for one in PICTURES])
    np.testing.assert_array_equal(trials.features[:5], clean)
    assert trials.features.dtype == np.float32
    assert (np.abs(trials.features[5:, :3] - clean[:, :3]).max(axis=1) > 1.0).all()


def test_at_the_views_themselves_all_trials_are_made_worse() -> None:
    trials = trials_of(AT, PICTURES, MeanColour(), between=False)
    assert trials.disturbed.tolist() == [True] * 5
    np.testing.assert_array_equal(trials.directions, AT)
    np.testing.assert_array_equal(trials.features, trials_of(AT, PICTURES, MeanColour()).features[5:])


def test_every_picture_is_made_worse_in_its_own_way() -> None:
    same = trials_of(AT, [PICTURES[0]] * 5, MeanColour(), between=False)
    assert len(np.unique(same.features.round(3), axis=0)) == 5
