"""What is behind and around the object: the interface, and what it says of a picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from viewsep.messages import Array, FloatArray
from viewsep.perception.boxes import Box


@dataclass(frozen=True, eq=False, slots=True)
class Difference:
    """What differs from the ground in a box of a picture: `differs` (h, w) uint8 with 1 there.

    `shade` (h, w) uint8 is 1 where the ground seems to lie in shadow. `problem` is empty, or a sentence that says why
    the ground is not to be trusted. `light` (3,) is how bright the ground is by channel, in a unit that stays the same,
    None where nobody knows.
    """

    differs: Array
    shade: Array
    problem: str = ""
    light: FloatArray | None = None


class Ground(Protocol):
    """What is behind and around the object. `shows_holder` says whether the holder is a part of it."""

    @property
    def shows_holder(self) -> bool:
        """Whether the holder is expected to be seen, so that what differs in its place is in front of it."""
        ...

    def difference(self, image: Array, joints: Sequence[float], box: Box) -> Difference:
        """Where an (H, W, 3) uint8 picture taken at joint angles (n,) differs from the ground within the box.

        Soft shadows are ground. Raises BadInput for a picture that cannot be compared.
        """
        ...
