"""Looks at an object while it is learned, as good and as bad as they will come: the likelihood is learned from them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from viewsep.interfaces import Descriptor
from viewsep.messages import Array, FloatArray
from viewsep.models.aspect_graph import Trials
from viewsep.sim.disturbances import Disturbances, disturbed

Picture = tuple[Array, Array]
"""Image (H, W, 3) uint8 RGB and mask (H, W) bool."""
LIGHT, NOISE, BLUR_PX, MASK_ERROR = 0.3, 0.05, 1.0, 0.03  # the strongest there are
CONSTANT_LIGHT, WHITE_BALANCE = 0.3, 0.1


def trial_directions(count: int) -> FloatArray:
    """(count, 3) unit vectors, drawn evenly from the sphere, always the same."""
    drawn = np.random.default_rng([count, 7]).normal(size=(count, 3))
    directions: FloatArray = drawn / np.linalg.norm(drawn, axis=1, keepdims=True)
    return directions


def rolls(count: int) -> FloatArray:
    """(count,) radians by which the camera is rolled, always the same: no descriptor should mind."""
    return np.random.default_rng([count, 8]).uniform(0.0, 2.0 * np.pi, count)


def trials_of(
    directions: FloatArray, pictures: Sequence[Picture], descriptor: Descriptor, *, between: bool = True
) -> Trials:
    """Every picture from its direction (T, 3) made worse and, where they lie `between` the views, as it is, too.

    Raises BadInput as `describe` does.
    """
    worse = [made_worse(*picture, np.random.default_rng([k, 9])) for k, picture in enumerate(pictures)]
    looks = [*pictures, *worse] if between else worse
    return Trials(
        directions=np.concatenate([directions, directions]) if between else directions,
        features=np.stack([descriptor.describe(image, mask) for image, mask in looks]),
        disturbed=np.arange(len(looks)) >= len(looks) - len(worse),
    )


def made_worse(image: Array, mask: Array, rng: np.random.Generator) -> Picture:
    """Another exposure and white balance, and some light, noise, blur and mask error."""
    gain = rng.uniform(1.0 - CONSTANT_LIGHT, 1.0 + CONSTANT_LIGHT) * rng.uniform(
        1 - WHITE_BALANCE, 1 + WHITE_BALANCE, 3
    )
    picture = np.clip(image * gain, 0, 255).astype(np.uint8)
    strength = rng.uniform(0.0, 1.0, 3)
    worse = Disturbances(
        light=LIGHT,
        noise=NOISE * strength[0],
        blur_px=BLUR_PX * strength[1],
        mask_error=MASK_ERROR * strength[2],
    )
    return disturbed(picture, mask, worse, rng)
