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


def _within(values: Array, least: int, most: int) -> Array:
    """(h, w) uint8, 255 where the values are between the two or equal to one of them."""
    return np.asarray(cv2.inRange(values, np.array([least]), np.array([most])))
