"""What a real camera would see of the rig: the object on its surroundings, with shadow, holder and changing light."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from viewsep.messages import Array, BoolArray
from viewsep.sim.desk import desk, gripper, lit_from_a_side, plain, plate_print, turned_plate

PLATE_TILT = 0.4  # height over width of the plate as it is seen
GRIPPER_COLOUR = np.array([70.0, 74.0, 82.0], np.float32)
NEVER_S = float("inf")


@dataclass(frozen=True, slots=True)
class Staging:
    """How the scene is set and what goes wrong in it; everything follows from `seed`, `occasion` and the moment.

    `size` (width, height) pixels; the object's picture is `object_px` wide and in the middle, moved by `offset_px`.
    `shadow` is the share of the light it takes where it is darkest. `exposure_drift` is by how much the exposure
    wanders, within a period of `drift_period_s`; `exposure_offset` is how far off it may be for good; `colour_drift`
    each colour of its own; `gain` is what the camera makes of the light. `noise` grey levels, `shake_px` the most the
    camera is off. From `removed_s` to `put_back_s` the object is gone, from `moved_s` on it is `moved_px` aside. From
    `switched_s` on other lamps are lit, `switched_to` times as bright, more of it to one side by `switched_slope`. On
    another `occasion` the same scene is exposed otherwise.
    """

    background: Literal["desk", "plain"] = "desk"
    plate: bool = False
    gripper: bool = False
    size: tuple[int, int] = (640, 480)
    object_px: int = 280
    offset_px: tuple[int, int] = (0, 0)
    shadow: float = 0.45
    exposure_drift: float = 0.08
    drift_period_s: float = 20.0
    exposure_offset: float = 0.1
    colour_drift: float = 0.02
    gain: float = 1.0
    noise: float = 2.0
    shake_px: float = 0.7
    removed_s: float = NEVER_S
    put_back_s: float = NEVER_S
    moved_s: float = NEVER_S
    moved_px: tuple[int, int] = (60, 0)
    switched_s: float = NEVER_S
    switched_to: float = 0.6
    switched_slope: tuple[float, float] = (0.35, -0.2)
    seed: int = 0
    occasion: tuple[int, ...] = ()

    @property
    def chance(self) -> tuple[int, ...]:
        """What exposures follow from: seeds."""
        return (self.seed, *self.occasion)


class Stage:
    """Puts an object's picture into its surroundings. Holds no state: the same arguments give the same picture."""

    def __init__(self, staging: Staging) -> None:
        self.staging = s = staging
        paint = desk if s.background == "desk" else plain
        self._ground = paint(s.seed, s.size).astype(np.float32)
        self._plate = plate_print(s.seed, round(0.36 * s.size[0])) if s.plate else None
        self._middle = s.size[0] / 2 + s.offset_px[0], 0.52 * s.size[1] + s.offset_px[1]

    def exposed(
        self, picture: Array, mask: Array, joints: Sequence[float], stamp_ns: int, sequence: int
    ) -> tuple[Array, BoolArray]:
        """The camera's picture (H, W, 3) uint8, and the true mask (H, W) of what is seen of the object.

        `picture` (S, S, 3) and `mask` (S, S) show the object alone; an empty mask makes an empty rig.
        """
        s, rng = self.staging, np.random.default_rng([*self.staging.chance, 24, sequence])
        seconds = stamp_ns * 1e-9
        scene = self._surroundings(joints)
        opacity, colours = self._placed(picture, mask, seconds)
        if s.shadow > 0 and opacity.any():
            scene = scene * (1.0 - self._shadow(opacity))[..., None]
        scene = scene + opacity[..., None] * (colours - scene)
        if s.gripper:
            held = self._gripper(joints)
            scene, opacity = scene + held[..., None] * (GRIPPER_COLOUR - scene), opacity * (1.0 - held)
        scene, opacity = _shaken(scene, opacity, rng.uniform(-s.shake_px, s.shake_px, 2))
        scene = scene * self.exposure(seconds)
        if seconds >= s.switched_s:
            scene = lit_from_a_side(scene * s.switched_to, np.array(s.switched_slope)).astype(np.float32)
        if s.noise > 0:
            scene = scene + rng.standard_normal(scene.shape, np.float32) * np.float32(s.noise)
        return np.clip(scene + 0.5, 0, 255).astype(np.uint8), opacity >= 0.5

    def exposure(self, seconds: float) -> Array:
        """(3,) float32 by which red, green and blue are too bright at a moment."""
        s, rng = self.staging, np.random.default_rng([*self.staging.chance, 25])
        offset = 1.0 + rng.uniform(-s.exposure_offset, s.exposure_offset)
        phases = rng.uniform(0.0, 2.0 * np.pi, 4)
        turn = 2.0 * np.pi * seconds / s.drift_period_s
        wander = 1.0 + s.exposure_drift * np.sin(turn + phases[0])
        colours = 1.0 + s.colour_drift * np.sin(0.7 * turn + phases[1:])
        return np.asarray(s.gain * offset * wander * colours, np.float32)

    def _surroundings(self, joints: Sequence[float]) -> Array:
        """(H, W, 3) float32 without object and gripper."""
        if self._plate is None:
            return self._ground
        s = self.staging
        middle = self._middle[0], self._middle[1] + 0.32 * s.object_px
        plate = turned_plate(self._plate, joints[-1], middle, PLATE_TILT, s.size).astype(np.float32)
        opacity = plate[..., 3:] / np.float32(255.0)
        seen: Array = self._ground + opacity * (plate[..., :3] - self._ground)
        return seen

    def _placed(self, picture: Array, mask: Array, seconds: float) -> tuple[Array, Array]:
        """Opacity (H, W) and colours (H, W, 3) of the object in the camera's picture, float32."""
        s = self.staging
        opacity = np.zeros((s.size[1], s.size[0]), np.float32)
        colours = np.zeros((s.size[1], s.size[0], 3), np.float32)
        if not mask.any() or s.removed_s <= seconds < s.put_back_s:
            return opacity, colours
        aside = s.moved_px if seconds >= s.moved_s else (0, 0)
        left, top = (round(self._middle[k] + aside[k] - s.object_px / 2) for k in (0, 1))
        size = picture.shape[1], picture.shape[0]
        scale = s.object_px / size[0]
        place = np.array([[scale, 0.0, left], [0.0, scale, top]])
        soft, own = _without_rim(picture, mask)
        cv2.warpAffine(soft, place, s.size, dst=opacity, flags=cv2.INTER_LINEAR)
        cv2.warpAffine(own, place, s.size, dst=colours, flags=cv2.INTER_LINEAR)
        return opacity, colours

    def _shadow(self, opacity: Array) -> Array:
        """(H, W) share of the light that the object takes: near it, to its lower right, soft."""
        s = self.staging
        aside = np.array([[1.0, 0.0, 0.09 * s.object_px], [0.0, 1.0, 0.06 * s.object_px]])
        moved = cv2.warpAffine(opacity, aside, s.size)
        small = cv2.resize(moved, None, fx=0.25, fy=0.25, interpolation=cv2.INTER_AREA)
        soft = cv2.GaussianBlur(small, (0, 0), 0.05 * s.object_px / 4)
        return np.asarray(s.shadow * cv2.resize(soft, s.size, interpolation=cv2.INTER_LINEAR))

    def _gripper(self, joints: Sequence[float]) -> Array:
        s = self.staging
        return gripper(joints[-1], (self._middle[0], self._middle[1] - 0.3 * s.object_px), 0.28 * s.object_px, s.size)


def _without_rim(picture: Array, mask: Array) -> tuple[Array, Array]:
    """Opacity and colours of the object: the rim, where a render mixes it with white, gets the colours next to it."""
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(np.float32)
    own = picture.astype(np.float32)
    share = cv2.GaussianBlur(inner, (0, 0), 1.5)[..., None]
    near = cv2.GaussianBlur(own * inner[..., None], (0, 0), 1.5) / np.maximum(share, 1e-3)
    colours: Array = np.where(inner[..., None] > 0, own, np.where(share > 1e-3, near, own))
    return cv2.GaussianBlur(mask.astype(np.float32), (0, 0), 0.6), colours.astype(np.float32)


def _shaken(scene: Array, opacity: Array, by: Array) -> tuple[Array, Array]:
    if not by.any():
        return scene, opacity
    size = scene.shape[1], scene.shape[0]
    shift = np.array([[1.0, 0.0, by[0]], [0.0, 1.0, by[1]]])
    moved = cv2.warpAffine(scene, shift, size, borderMode=cv2.BORDER_REPLICATE)
    return moved, cv2.warpAffine(opacity, shift, size, borderMode=cv2.BORDER_REPLICATE)
