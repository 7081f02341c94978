"""How much brighter one picture is than another, by channel."""

from __future__ import annotations

import cv2
import numpy as np

from viewsep.messages import Array, FloatArray

STRIDE = 12  # pixels between samples
USABLE = (20, 250)  # grey levels: darker ones are noise, brighter ones clipped


def samples(picture: Array) -> Array:
    """Every STRIDE-th pixel of a picture (H, W, ...) in both directions, one after the other (N, ...)."""
    every = picture[STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE]
    return every.reshape(-1, *picture.shape[2:])


def places(length: int) -> Array:
    """The rows, or the columns, of the samples of a picture of that height, or width."""
    return np.arange(STRIDE // 2, length, STRIDE)


def gains(seen: Array, expected: Array) -> FloatArray:
    """(3,) by which the colours `seen` (N, 3) are brighter than those `expected`; 1 where none can be compared."""
    gain = np.ones(3)
    for channel in range(3):
        a, b = seen[:, channel], expected[:, channel]
        usable = (b >= USABLE[0]) & (b <= USABLE[1]) & (a < USABLE[1]) & (a > 0)
        if usable.sum() >= 20:
            gain[channel] = np.median(a[usable].astype(np.float32) / b[usable])
    return gain


def scaled(picture: Array, gain: FloatArray, offset: float = 0.0) -> Array:
    """An (h, w, 3) uint8 picture times the gain (3,) plus an offset, clipped."""
    table = np.arange(256.0)[:, None] * gain[None] + offset
    return np.asarray(cv2.LUT(picture, np.clip(np.rint(table), 0, 255).astype(np.uint8)[None]))
