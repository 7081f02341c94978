"""Soft shadows: the background darker, at about the same chromaticity and without edges of its own."""

from __future__ import annotations

import cv2
import numpy as np

from viewsep.messages import Array

SAME = 128  # what a picture as bright as the background has after the division
DARKEST, BRIGHTEST = 52, 126  # of 128: shadows take up to 60 % of the light
COLOUR_SPREAD = 16  # of 128, between the most and the least darkened channel
STEEPEST = 8  # of 128, from a pixel of the smoothed ratio to its neighbours: soft shadows have no edges
AROUND = np.ones((3, 3), np.uint8)
PRINTED = 40  # grey levels between the darkest and the brightest that is seen of the ground where it has an edge
BESIDE, BESIDE_SHARE, ROOM = (11, 11), 0.15, 6.0  # pixels around such an edge, how many are shadow, grey levels


def soft_shadow(image: Array, ground: Array) -> Array:
    """(h, w) uint8, 1 where the (h, w, 3) uint8 `image` is the `ground` under a soft shadow."""
    red, green, blue = cv2.split(cv2.divide(image, ground, scale=float(SAME)))  # zero where the ground is black
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
    apart = cv2.split(cv2.subtract(upper, lower))
    printed = cv2.max(cv2.max(apart[0], apart[1]), apart[2])
    beside = cv2.boxFilter(shadow, -1, BESIDE, normalize=False)
    edges = (printed > PRINTED) & (beside > BESIDE_SHARE * BESIDE[0] * BESIDE[1])
    points = cv2.findNonZero(edges.view(np.uint8))
    if points is None:
        return np.zeros_like(shadow)
    columns, rows = points[:, 0].T
    here = rows * shadow.shape[1] + columns
    seen, whole = (
        cv2.boxFilter(cv2.multiply(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY), shadow), cv2.CV_32F, BESIDE)
        for picture in (image, ground)
    )
    level = (seen.take(here) / np.maximum(whole.take(here), 1e-3))[:, None]
    at, low, high = (picture.reshape(-1, 3).take(here, axis=0) for picture in (image, lower, upper))
    within = (at >= low * level - ROOM) & (at <= high * level + ROOM)
    shaded = np.zeros_like(shadow)
    shaded[rows, columns] = within[:, 0] & within[:, 1] & within[:, 2]  # faster than all()
    return shaded


def _within(values: Array, least: int, most: int) -> Array:
    """(h, w) uint8, 255 where the values are between the two or equal to one of them."""
    return np.asarray(cv2.inRange(values, np.array([least]), np.array([most])))
