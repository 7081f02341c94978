"""Painted surroundings of the simulated rig: a cluttered desk, a plain backdrop, a plate with a print, a gripper."""

from __future__ import annotations

import cv2
import numpy as np

from viewsep.messages import Array

Size = tuple[int, int]
"""Width and height in pixels."""


def desk(seed: int, size: Size) -> Array:
    """(H, W, 3) uint8: a wooden table with books, cables, papers and coins on it, drawn from the seed."""
    width, height = size
    rng = np.random.default_rng([seed, 21])
    grain = cv2.resize(rng.normal(0.0, 1.0, (height, max(2, width // 40))), size, interpolation=cv2.INTER_CUBIC)
    wood = np.array([150.0, 115.0, 80.0]) * rng.uniform(0.7, 1.2) + rng.uniform(-15, 15, 3)
    picture = np.clip(wood + 7.0 * grain[..., None], 0, 255).astype(np.uint8)
    unit_px = min(size) / 48
    for _ in range(26):
        colour = tuple(int(c) for c in rng.integers(20, 236, 3))
        x, y = (int(rng.uniform(0, n)) for n in size)
        if rng.random() < 0.5:
            sides = rng.uniform(3, 12, 2) * unit_px
            corners = cv2.boxPoints(((x, y), (float(sides[0]), float(sides[1])), float(rng.uniform(0, 180))))
            cv2.fillPoly(picture, [np.rint(corners).astype(np.int32)], colour, cv2.LINE_AA)
        elif rng.random() < 0.5:
            cv2.circle(picture, (x, y), round(rng.uniform(1, 4) * unit_px), colour, -1, cv2.LINE_AA)
        else:
            path = np.array([x, y]) + np.cumsum(rng.normal(0, 4 * unit_px, (9, 2)), axis=0)
            cv2.polylines(
                picture, [np.rint(path).astype(np.int32)], False, colour, max(1, round(unit_px / 3)), cv2.LINE_AA
            )
    return lit_from_a_side(cv2.GaussianBlur(picture, (0, 0), 0.8), rng.uniform(-0.1, 0.1, 2))


def plain(seed: int, size: Size) -> Array:
    """(H, W, 3) uint8: a backdrop of one light or dark colour, a little brighter on one side."""
    rng = np.random.default_rng([seed, 22])
    level = rng.uniform(170, 215) if rng.random() < 0.5 else rng.uniform(45, 80)
    picture = np.full((size[1], size[0], 3), level + rng.uniform(-8, 8, 3))
    return lit_from_a_side(picture, rng.uniform(-0.06, 0.06, 2))


def lit_from_a_side(picture: Array, slope: Array) -> Array:
    """The picture with brightness that changes by `slope` (2,) from its middle to its right and lower border."""
    height, width = picture.shape[:2]
    x, y = np.linspace(-1, 1, width), np.linspace(-1, 1, height)
    light = 1.0 + slope[0] * x[None, :] + slope[1] * y[:, None]
    lit: Array = np.clip(picture * light[..., None], 0, 255).astype(np.uint8)
    return lit


def plate_print(seed: int, radius_px: int) -> Array:
    """(2r, 2r, 4) uint8 RGBA: a round plate seen from above with a printed scale, dots and letters."""
    rng = np.random.default_rng([seed, 23])
    side, middle = 2 * radius_px, (radius_px, radius_px)
    plate = np.zeros((side, side, 4), np.uint8)
    cv2.circle(plate, middle, radius_px - 2, (205, 205, 200, 255), -1, cv2.LINE_AA)
    for step in range(36):
        angle = np.radians(10 * step)
        ends = [
            (round(radius_px * (1 + share * np.cos(angle))), round(radius_px * (1 + share * np.sin(angle))))
            for share in (0.86 if step % 3 else 0.8, 0.95)
        ]
        cv2.line(plate, ends[0], ends[1], (40, 40, 45, 255), max(1, radius_px // 60), cv2.LINE_AA)
    for _ in range(14):
        angle, away = rng.uniform(0, 2 * np.pi), radius_px * rng.uniform(0.2, 0.75)
        place = (round(radius_px + away * np.cos(angle)), round(radius_px + away * np.sin(angle)))
        colour = (*(int(c) for c in rng.integers(30, 220, 3)), 255)
        cv2.circle(plate, place, max(1, round(radius_px * rng.uniform(0.03, 0.09))), colour, -1, cv2.LINE_AA)
    return plate


def turned_plate(plate: Array, angle_rad: float, middle: tuple[float, float], tilt: float, size: Size) -> Array:
    """The plate (2r, 2r, 4) turned and seen at an angle: (H, W, 4), its height `tilt` times its width."""
    radius = plate.shape[0] / 2
    c, s = np.cos(angle_rad), np.sin(angle_rad)
    turn = np.array([[c, -s], [tilt * s, tilt * c]])
    shift = np.array(middle) - turn @ [radius, radius]
    return np.asarray(cv2.warpAffine(plate, np.column_stack([turn, shift]), size, flags=cv2.INTER_AREA))


def gripper(angle_rad: float, tip: tuple[float, float], width_px: float, size: Size) -> Array:
    """(H, W) float32 opacity of an arm from above with two fingers that end at `tip`; it turns about its own axis."""
    opacity = np.zeros((size[1], size[0]), np.uint8)
    apart = width_px * (0.25 + 0.55 * abs(np.cos(angle_rad)))
    thick = max(2.0, 0.22 * width_px)
    wrist = tip[1] - 1.1 * width_px
    for side in (-1, 1):
        x = tip[0] + side * apart / 2
        _rectangle(opacity, (x - thick / 2, wrist), (x + thick / 2, tip[1]))
    _rectangle(
        opacity, (tip[0] - apart / 2 - thick / 2, wrist - 0.4 * width_px), (tip[0] + apart / 2 + thick / 2, wrist)
    )
    _rectangle(opacity, (tip[0] - 0.3 * width_px, -10.0), (tip[0] + 0.3 * width_px, wrist - 0.3 * width_px))
    soft: Array = cv2.GaussianBlur(opacity, (0, 0), 0.7).astype(np.float32) / np.float32(255.0)
    return soft


def _rectangle(opacity: Array, corner: tuple[float, float], opposite: tuple[float, float]) -> None:
    a, b = ((round(x), round(y)) for x, y in (corner, opposite))
    cv2.rectangle(opacity, a, b, 255, -1)
