"""What holds the object and is seen beside it: a mask by joint angle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from viewsep.errors import BadInput
from viewsep.messages import Array, BoolArray
from viewsep.perception.angles import Angles
from viewsep.perception.boxes import whole
from viewsep.perception.ground import Ground

MARGIN = np.ones((5, 5), np.uint8)  # around the holder, for between the captures and for the camera's shaking


@dataclass(frozen=True, eq=False, slots=True)
class Holder:
    """Masks (K, H, W) bool of the holder at K captured angles; one for a holder that does not move."""

    masks: BoolArray
    angles: Angles

    def at(self, joints: Sequence[float], shape: tuple[int, int]) -> BoolArray:
        """(H, W) bool at joint angles (n,): what the captures around them show. Raises BadInput."""
        if self.masks.shape[1:] != shape:
            raise BadInput(
                f"the holder's mask is {self.masks.shape[2]} x {self.masks.shape[1]}, but the picture is {shape[1]} x "
                f"{shape[0]} pixels: make the mask from pictures of this camera"
            )
        if len(self.masks) == 1:
            return np.asarray(self.masks[0])
        near, _ = self.angles.nearest(joints)
        return np.asarray(self.masks[near].any(axis=0))


def still_holder(mask: BoolArray) -> Holder:
    """A holder that is always in the same place, from an (H, W) bool mask."""
    return Holder(mask[None], Angles(np.zeros((1, 0)), np.zeros(0, bool)))


def learn_holder(
    frames: Sequence[tuple[Array, Sequence[float]]], ground: Ground, turns: Sequence[bool] | None = None
) -> Holder:
    """What stands out from `ground` in pictures of the empty rig (H, W, 3) with their joint angles (n,).

    Raises BadInput without pictures, and where they do not suit the ground.
    """
    if not frames:
        raise BadInput("no pictures of the empty rig: a holder is learned from at least one")
    masks = []
    for image, joints in frames:
        found = ground.difference(image, joints, whole((image.shape[0], image.shape[1])))
        if found.problem:
            raise BadInput(f"the holder cannot be learned: {found.problem}")
        clean = cv2.morphologyEx(found.differs, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
        masks.append(cv2.dilate(clean, MARGIN) > 0)
    joints_rad = np.array([list(joints) for _, joints in frames], float).reshape(len(frames), -1)
    turning = np.ones(joints_rad.shape[1], bool) if turns is None else np.array(turns, bool)
    return Holder(np.stack(masks), Angles(joints_rad, turning))
