"""How much brighter one picture is than another, by channel."""

from __future__ import annotations

import cv2
import numpy as np

from viewsep.messages import Array, FloatArray

STRIDE = 12  # pixels between samples
USABLE = (20, 250)  # grey levels: darker ones are noise, brighter ones clipped
FEWEST_USABLE = 20


def samples(picture: Array) -> Array:
    """Every STRIDE-th pixel of a picture (H, W, ...) in both directions, one after the other (N, ...)."""
    every = picture[STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE]
    return every.reshape(-1, *picture.shape[2:])


def places(length: int) -> Array:
    """The rows, or the columns, of the samples of a picture of that height, or width."""
    return np.arange(STRIDE // 2, length, STRIDE)


def gains(seen: Array, expected: Array) -> FloatArray:
    """(3,) by which the colours `seen` (N, 3) are brighter than those `expected`; 1 where none can be compared."""
    if len(seen) < FEWEST_USABLE:
        return np.ones(3)
    usable = (expected >= USABLE[0]) & (expected <= USABLE[1]) & (seen < USABLE[1]) & (seen > 0)
    ratio = np.where(usable, seen.astype(np.float32) / np.maximum(expected, 1), np.float32(np.inf))
    ordered, count, channel = np.sort(ratio, axis=0), usable.sum(axis=0), np.arange(3)  # the usable ones are first
    median = 0.5 * (ordered[(count - 1) // 2, channel] + ordered[count // 2, channel])
    return np.where(count >= FEWEST_USABLE, median, 1.0).astype(float)


def scaled(picture: Array, gain: FloatArray, offset: float = 0.0) -> Array:
    """An (h, w, C) uint8 picture times the gain (C,) plus an offset, clipped."""
    table = np.arange(256.0)[:, None] * gain[None] + offset
    return np.asarray(cv2.LUT(picture, np.clip(np.rint(table), 0, 255).astype(np.uint8)[None]))
