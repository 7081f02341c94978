"""A part of the picture that is always the object: for rigs that show nothing else there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from viewsep.errors import BadInput
from viewsep.messages import Array
from viewsep.perception.boxes import Box
from viewsep.perception.figure_ground import Figure
from viewsep.perception.holder import Holder
from viewsep.perception.quality import Quality
from viewsep.perception.tracking import Track


@dataclass(frozen=True, slots=True)
class FixedRegion:
    """`FigureGround` that takes the box for the object, without the holder. There is nothing to judge."""

    box: Box
    holder: Holder | None = None

    def segment(self, image: Array, joints: Sequence[float], track: Track) -> Figure:
        """The region's mask. Raises BadInput where it does not lie in the picture."""
        box, shape = self.box, (image.shape[0], image.shape[1])
        if not (0 <= box.left < box.right <= shape[1] and 0 <= box.top < box.bottom <= shape[0]):
            raise BadInput(
                f"the region of columns {box.left} to {box.right} and rows {box.top} to {box.bottom} does not lie in "
                f"the picture of {shape[1]} x {shape[0]} pixels: correct key 'perception.region'"
            )
        mask = np.zeros(shape, bool)
        mask[box.part] = True
        if self.holder is not None:
            mask &= ~self.holder.at(joints, shape)
        return Figure(mask, Quality(1.0, {}), "", track.after(box, int(mask.sum()), tuple(joints), True, track.memory))
