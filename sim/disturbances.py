"""What goes wrong on a real rig, seeded and off by default."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from viewsep.messages import Array

EVEN = np.ones(3, np.float32)


@dataclass(frozen=True, slots=True)
class Disturbances:
    """Strengths; 0 is off.

    `light` relative brightness change per frame (0.3: uniform in ±30 %), `light_offset` the same for all frames of a
    task, `white_balance` likewise and for every colour, `noise` standard deviation as a share of full scale, `blur_px`
    Gaussian sigma, `mask_error` share of the mask's outline that is wrong (as a share of its area), `backlash_deg` play
    of every joint, `encoder_noise_deg` standard deviation, `latency_s` from exposure to delivery, `drop_rate` share of
    frames lost, `slip_deg` one slip of the object in its holder, `slip_after_s` when it slips.
    """

    light: float = 0.0
    light_offset: float = 0.0
    white_balance: float = 0.0
    noise: float = 0.0
    blur_px: float = 0.0
    mask_error: float = 0.0
    backlash_deg: float = 0.0
    encoder_noise_deg: float = 0.0
    latency_s: float = 0.0
    drop_rate: float = 0.0
    slip_deg: float = 0.0
    slip_after_s: float = 5.0


def constant_gains(disturbances: Disturbances, seed: int) -> Array:
    """(3,) float32 by which red, green and blue are too bright in all frames of a task."""
    d, rng = disturbances, np.random.default_rng([seed, 6])
    light = 1.0 + rng.uniform(-d.light_offset, d.light_offset)
    gains: Array = (light * (1.0 + rng.uniform(-d.white_balance, d.white_balance, 3))).astype(np.float32)
    return gains


def disturbed(
    image: Array, mask: Array, disturbances: Disturbances, rng: np.random.Generator, gains: Array = EVEN
) -> tuple[Array, Array]:
    """Picture (H, W, 3) uint8 and mask (H, W) bool with light, blur, noise and mask error applied.

    `gains` (3,) are those of the whole task, beside the light of this frame.
    """
    d = disturbances
    if d.mask_error > 0:
        mask = _wrong_mask(mask, d.mask_error, rng)
    if d.light == d.noise == d.blur_px == 0 and (gains == 1.0).all():
        return image, mask
    picture: Array = image.astype(np.float32) * (gains * np.float32(1.0 + rng.uniform(-d.light, d.light)))
    if d.blur_px > 0:
        picture = cv2.GaussianBlur(picture, (0, 0), d.blur_px)
    if d.noise > 0:
        picture = picture + rng.normal(0.0, 255.0 * d.noise, image.shape).astype(np.float32)
    return np.clip(picture, 0, 255).astype(np.uint8), mask


def _wrong_mask(mask: Array, share: float, rng: np.random.Generator) -> Array:
    """Blobs of the given share of the mask's area added or taken away along its outline."""
    wrong = mask.copy()
    outline = np.argwhere(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0)
    wanted, done = share * mask.sum(), 0.0
    while done < wanted and len(outline) > 0:
        y, x = outline[rng.integers(len(outline))]
        radius = int(rng.integers(2, max(3, len(mask) // 16)))
        blob = np.zeros(mask.shape, np.uint8)
        cv2.circle(blob, (int(x), int(y)), radius, 1, -1)
        wrong[blob > 0] = rng.random() < 0.5
        done += np.pi * radius**2 / 2
    return wrong if wrong.any() else mask
