"""Pictures of the empty rig by the joint angles they were taken at: which of them are nearest to others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from viewsep.errors import BadInput
from viewsep.messages import Array, FloatArray

ROOM = 1.5  # times the spacing of the captures: as far from them a picture is still explained by them


@dataclass(frozen=True, eq=False)
class Angles:
    """Joint angles (K, n) in radians, NaN of joints that do not show: any angle of theirs is as good.

    `turns` (n,) bool: joints for which a whole turn changes nothing.
    """

    joints: FloatArray
    turns: Array

    def away(self, joints: Sequence[float]) -> FloatArray:
        """(K,) how far joints (n,) are from each capture: the most any of them differs. Raises BadInput."""
        if len(joints) != self.joints.shape[1]:
            raise BadInput(
                f"the empty rig was captured with {self.joints.shape[1]} joints, but this rig has {len(joints)}: "
                "capture it again on this rig"
            )
        away = np.abs(self.joints - np.asarray(joints, float))
        around = np.abs((away + np.pi) % (2 * np.pi) - np.pi)
        nearest: FloatArray = np.nan_to_num(np.where(self.turns, around, away)).max(axis=1, initial=0.0)
        return nearest

    @cached_property
    def spacing(self) -> float:
        """The largest distance from a capture to the one next to it, radians; infinite for a single one."""
        if len(self.joints) < 2:
            return np.inf
        return float(max(np.partition(self.away(joints.tolist()), 1)[1] for joints in np.nan_to_num(self.joints)))

    def nearest(self, joints: Sequence[float]) -> tuple[list[int], float]:
        """The captures around joints (n,), nearest first, and how far the nearest is beyond what they explain, or 0."""
        if len(self.joints) == 1:
            return [0], 0.0
        away = self.away(joints)
        order = np.argsort(away, kind="stable")[: len(joints) + 1]
        return [int(k) for k in order], max(0.0, float(away[order[0]]) - ROOM * self.spacing)
