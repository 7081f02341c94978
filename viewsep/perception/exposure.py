"""How much of the object is burnt out or black: what it looks like there cannot be seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from viewsep.messages import Array
from viewsep.perception.light import samples

WHITE, BLACK = 253, 3
DARK = 24  # grey levels that more than half of a picture stays below
CLIPPED = 0.25  # of the object's pixels that may be white in all channels, or black
LOWER, RAISE = "lower the exposure or the gain", "raise the exposure, or add light"


@dataclass(frozen=True, slots=True)
class Clipped:
    """`white` and `black` are shares of the object's pixels."""

    white: float
    black: float

    @property
    def problem(self) -> str:
        """What is wrong with the exposure, with the share; empty when it is good."""
        if self.white > CLIPPED:
            return f"{self.white:.0%} of the object is burnt out: {LOWER}"
        return f"{self.black:.0%} of the object is black: {RAISE}" if self.black > CLIPPED else ""

    @property
    def note(self) -> str:
        """The same in words that do not change from picture to picture."""
        if self.white > CLIPPED:
            return f"more than {CLIPPED:.0%} of the object is burnt out: {LOWER}"
        return f"more than {CLIPPED:.0%} of the object is black: {RAISE}" if self.black > CLIPPED else ""


def clipped(pixels: Array) -> Clipped:
    """Of the object's pixels (N, 3) uint8 RGB. Without any nothing is clipped."""
    if len(pixels) == 0:
        return Clipped(0.0, 0.0)
    return Clipped(float((pixels.min(axis=1) >= WHITE).mean()), float((pixels.max(axis=1) <= BLACK).mean()))


def badly_exposed(image: Array) -> str:
    """What is wrong with the exposure of a whole picture (H, W, 3) uint8 in which no object is found, if anything."""
    brightest = samples(image).max(axis=1)
    over = float((brightest >= WHITE).mean())
    if over > CLIPPED:
        return f"the picture is over-exposed, {over:.0%} of it is clipped: {LOWER}"
    return too_dark(image)


def too_dark(image: Array) -> str:
    """What to say of a picture (H, W, 3) uint8 most of which is next to black; empty for others."""
    level = float(np.median(samples(image).max(axis=1)))
    return f"the picture is too dark, half of it is below {level:.0f} of 255: {RAISE}" if level < DARK else ""
