"""Rectangles of a picture, in whole pixels."""

from __future__ import annotations

from dataclasses import dataclass

import cv2

from viewsep.messages import Array


@dataclass(frozen=True, slots=True)
class Box:
    """Columns `left` to `right` and rows `top` to `bottom`, the last of each left out."""

    left: int
    top: int
    right: int
    bottom: int

    @property
    def part(self) -> tuple[slice, slice]:
        """To index pictures and masks with."""
        return slice(self.top, self.bottom), slice(self.left, self.right)

    def grown(self, by_px: int, shape: tuple[int, int]) -> Box:
        """Larger on all sides, within a picture of `shape` (H, W)."""
        height, width = shape
        return Box(
            max(0, self.left - by_px),
            max(0, self.top - by_px),
            min(width, self.right + by_px),
            min(height, self.bottom + by_px),
        )


def whole(shape: tuple[int, int]) -> Box:
    """All of a picture of `shape` (H, W)."""
    return Box(0, 0, shape[1], shape[0])


def around(mask: Array) -> Box | None:
    """The smallest box that holds all of an (H, W) bool or uint8 mask; None where it is empty."""
    left, top, width, height = cv2.boundingRect(mask.astype("uint8", copy=False))
    return Box(left, top, left + width, top + height) if width and height else None
