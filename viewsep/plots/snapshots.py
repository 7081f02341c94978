"""Pictures inside a page: chosen looks, reduced until all of them together stay small."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence

import cv2
import numpy as np

from viewsep.messages import Array
from viewsep.plots.story import Story

STEPS = 150  # pictures at most
STEPS_BYTES = 450_000  # all of them
SIDE_PX, LARGE_PX = 240, 480  # longer side of a small picture and of a large one
WEBP_QUALITY, LARGE_QUALITY = 80, 90


def spread(count: int, most: int) -> list[int]:
    """At most `most` indices below `count`, as even as they can be, always with the first and the last one."""
    if most < 2 or count <= 1:
        return list(range(min(count, 1)))
    return [int(index) for index in np.unique(np.linspace(0, count - 1, min(most, count)).round())]


def snapshots(story: Story) -> dict[int, bytes]:
    """Pictures (WebP) of looks, by the look's index from 0: of every one, or as many as fit into what they may take."""
    if not story.frames:
        return {}
    most, taken = STEPS, spread(len(story.looks), STEPS)
    pictures: dict[int, bytes] = {}
    while True:
        for index in taken:
            if index not in pictures:
                pictures[index] = small(story.frame_at(story.looks[index]).decode().image)
        size = sum(len(pictures[index]) for index in taken)
        if size <= STEPS_BYTES or len(taken) <= 2:
            return {index: pictures[index] for index in taken}
        most = max(2, min(len(taken) - 1, most * STEPS_BYTES // size))
        taken = spread(len(story.looks), most)


def small(image: Array) -> bytes:
    """A picture (H, W, 3) of the strip as WebP."""
    return _webp(image, SIDE_PX, WEBP_QUALITY)


def large(image: Array) -> str:
    """A picture (H, W, 3) that is looked at closely, as the address of an image."""
    return address(_webp(image, LARGE_PX, LARGE_QUALITY), "webp")


def thumbnail(image: Array) -> str:
    """A model's thumbnail (h, w, 3), exact, as the address of an image; empty where it has no pixels."""
    if image.size == 0:
        return ""
    return address(_encoded(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 9]), "png")


def address(data: bytes, kind: str) -> str:
    """An image's address that holds the image itself."""
    return f"data:image/{kind};base64,{b64encode(data).decode()}"


def _webp(image: Array, longest_px: int, quality: int) -> bytes:
    scale = longest_px / max(image.shape[:2])
    if scale < 1.0:
        height, width = (max(1, round(scale * length)) for length in image.shape[:2])
        image = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return _encoded(".webp", image, [cv2.IMWRITE_WEBP_QUALITY, quality])


def _encoded(extension: str, image: Array, options: Sequence[int]) -> bytes:
    return cv2.imencode(extension, cv2.cvtColor(image, cv2.COLOR_RGB2BGR), options)[1].tobytes()
