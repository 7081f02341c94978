"""Which views of an object are photographed, and in which order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from viewsep.geometry import angle_between
from viewsep.messages import Array, FloatArray
from viewsep.planning.reachable import ReachableViews
from viewsep.sim.view_set import Use

COVERED = 0.6  # of the spacing: no reachable view is further from a photographed one


@dataclass(frozen=True, eq=False, slots=True)
class Shot:
    """One photo to be taken, from `direction` (3,) in the control frame."""

    number: int
    direction: FloatArray
    use: Use


def plan_shots(reachable: ReachableViews, start: FloatArray, spacing_rad: float, trials: float) -> list[Shot]:
    """Reachable views about `spacing_rad` apart that leave no gap, and `trials` times as many between them.

    From `start` (3,) on every next one is near. Half of the trials come in a second pass at the end, when the light may
    have changed and joints arrive from other sides.
    """
    order, gap = _spread(reachable.directions, start)
    views = int(np.searchsorted(-gap, -COVERED * spacing_rad, side="right")) + 1
    count = min(round(trials * views), len(order) - views)
    second = count // 2
    first_pass, late = order[: views + count - second], order[views + count - second : views + count]
    use = dict.fromkeys(order[:views].tolist(), Use.VIEW)
    shots: list[Shot] = []
    here = start
    for part in (first_pass, late):
        for index in _tour(reachable.directions[part], here):
            node = int(part[index])
            here = reachable.directions[node]
            shots.append(Shot(len(shots), here, use.get(node, Use.TRIAL)))
    return shots


def _spread(directions: FloatArray, start: FloatArray) -> tuple[Array, FloatArray]:
    """All (M,) indices, each as far as can be from those before it, and (M - 1,) how far: farthest-point sampling."""
    order = [int(np.argmax(directions @ start))]
    nearest = angle_between(directions, directions[order[0]])
    gap = []
    for _ in range(len(directions) - 1):
        farthest = int(np.argmax(nearest))
        gap.append(float(nearest[farthest]))
        order.append(farthest)
        nearest = np.minimum(nearest, angle_between(directions, directions[farthest]))
    return np.array(order), np.array(gap)


def _tour(directions: FloatArray, start: FloatArray) -> list[int]:
    """An order of directions (N, 3) in which the next one is always the nearest that is left."""
    left, tour, here = list(range(len(directions))), [], start
    while left:
        nearest = left.pop(int(np.argmin(angle_between(directions[left], here))))
        tour.append(nearest)
        here = directions[nearest]
    return tour
