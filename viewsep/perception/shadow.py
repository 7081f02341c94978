"""Soft shadows: the background darker, at about the same chromaticity and without edges of its own."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from viewsep.messages import Array
from viewsep.perception.boxes import around

SAME = 128  # what a picture as bright as the background has after the division
DARKEST, BRIGHTEST = 52, 126  # of 128: shadows take up to 60 % of the light
COLOUR_SPREAD = 16  # of 128, between the most and the least darkened channel
STEEPEST = 8  # of 128, from a pixel of the smoothed ratio to its neighbours: soft shadows have no edges
AROUND = np.ones((3, 3), np.uint8)
PRINTED = 40  # grey levels between the darkest and the brightest that is seen of the ground where it has an edge
BESIDE, BESIDE_LEAST, ROOM = (11, 11), 19, 6.0  # pixels around such an edge, how many are shadow at least, grey levels


def soft_shadow(image: Array, ground: Array) -> Array:
    """(h, w) uint8, 1 where the (h, w, 3) uint8 `image` is the `ground` under a soft shadow."""
    red, green, blue = _channels(cv2.divide(image, ground, scale=float(SAME)))  # zero where the ground is black
    least, most = cv2.min(cv2.min(red, green), blue), cv2.max(cv2.max(red, green), blue)
    darker = _within(most, DARKEST, BRIGHTEST)
    grey = _within(cv2.subtract(most, least), 0, COLOUR_SPREAD)
    level = cv2.blur(cv2.addWeighted(least, 0.5, most, 0.5, 0.0), (3, 3))
    smooth = _within(cv2.morphologyEx(level, cv2.MORPH_GRADIENT, AROUND), 0, STEEPEST)
    shadow: Array = (darker & grey & smooth) >> 7
    return shadow


def shaded_print(image: Array, lower: Array, upper: Array, shadow: Array, ground: Array) -> Array:
    """(h, w) uint8, 1 where the ground's own edges lie within a shadow: as dark as the `shadow` (h, w) around them.

    A shaking camera sees such an edge between `lower` and `upper` (h, w, 3), darkened as what is beside it.
    """
    red, green, blue = _channels(cv2.subtract(upper, lower))
    printed = cv2.max(cv2.max(red, green), blue)
    beside = cv2.boxFilter(shadow, -1, BESIDE, normalize=False)
    edges = (printed > PRINTED) & (beside >= BESIDE_LEAST)
    shaded, box = np.zeros_like(shadow), around(edges)
    if box is None:
        return shaded
    part = box.grown(BESIDE[0] // 2, shadow.shape).part
    seen, whole = (
        cv2.boxFilter(cv2.cvtColor(picture[part], cv2.COLOR_RGB2GRAY) * shadow[part], cv2.CV_32F, BESIDE)
        for picture in (image, ground)
    )
    here, inside = np.flatnonzero(edges), np.flatnonzero(edges[part])
    level = (seen.take(inside) / np.maximum(whole.take(inside), 1e-3))[:, None]
    at, low, high = (picture.reshape(-1, 3).take(here, axis=0) for picture in (image, lower, upper))
    within = (at >= low * level - ROOM) & (at <= high * level + ROOM)
    shaded.put(here, within[:, 0] & within[:, 1] & within[:, 2])  # faster than all()
    return shaded


def _channels(picture: Array) -> Sequence[Array]:
    """The channels (h, w) of an (h, w, C) picture, into memory of their own: else OpenCV copies them once more."""
    return cv2.split(picture, [np.empty(picture.shape[:2], picture.dtype) for _ in range(picture.shape[2])])


def _within(values: Array, least: int, most: int) -> Array:
    """(h, w) uint8, 255 where the values are between the two or equal to one of them."""
    return np.asarray(cv2.inRange(values, np.array([least]), np.array([most])))
