"""What descriptors that bear with light see: lightness and two opponent colours, exposed on the object."""

from __future__ import annotations

import cv2
import numpy as np

from viewsep.messages import Array

EXPOSED_TO = 0.43  # mean lightness on the object after normalisation


def opponent_colours(image: Array, mask: Array | None, smooth_px: float) -> tuple[Array, Array]:
    """(H, W, 3) uint8 RGB and (H, W) bool -> (h, w, 3) float32 lightness, red-green, yellow-blue; (h, w) bool inside.

    Smoothed on the object alone, halved in size and exposed so that the object has a fixed mean lightness; zero where
    not inside the object.
    """
    on = np.ones(image.shape[:2], np.float32) if mask is None else mask.astype(np.float32)
    size = (max(1, image.shape[1] // 2), max(1, image.shape[0] // 2))
    blurred = cv2.GaussianBlur(image.astype(np.float32) * on[..., None], (0, 0), smooth_px)
    share = cv2.GaussianBlur(on, (0, 0), smooth_px)
    blurred = cv2.resize(blurred, size, interpolation=cv2.INTER_AREA)
    share = cv2.resize(share, size, interpolation=cv2.INTER_AREA)
    whole = cv2.resize(on, size, interpolation=cv2.INTER_AREA) > 0.99
    inside = cv2.erode(whole.astype(np.uint8), np.ones((3, 3), np.uint8), borderType=cv2.BORDER_REPLICATE) > 0
    channels = np.zeros((*inside.shape, 3), np.float32)
    colour = blurred[inside] / np.maximum(share[inside], 1e-3)[:, None] / np.float32(255.0)
    if len(colour) == 0:
        return channels, inside
    colour = np.clip(colour * (EXPOSED_TO / max(float(colour.mean()), 1e-3)), 0.0, 1.0)
    total = colour.sum(axis=1) + np.float32(0.15)
    channels[inside, 0] = colour.mean(axis=1)
    channels[inside, 1] = 2.0 * (colour[:, 0] - colour[:, 1]) / total
    channels[inside, 2] = (colour[:, 0] + colour[:, 1] - 2.0 * colour[:, 2]) / total
    return channels, inside
