"""The clairvoyant optimum: how short the way could have been, had the engine known everything from the start."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from viewsep.config import PluginConfig
from viewsep.geometry import angle_between, nearest_points
from viewsep.messages import BoolArray, FloatArray
from viewsep.models.aspect_graph import AspectGraph
from viewsep.planning.reachable import ReachableViews
from viewsep.plugins import make_descriptor

TELLING_SHARE = 0.5


def clairvoyant_travel(
    truth: AspectGraph,
    rivals: Sequence[AspectGraph],
    rotation: FloatArray,
    reachable: ReachableViews,
    start: FloatArray,
) -> float:
    """Radians from the `start` view (3,) to the closest reachable one that tells `truth` from its rivals.

    `rotation` (3, 3) is the true pose object -> control. 0 where the start view does so itself; infinite where no
    reachable view does.
    """
    tells = telling_nodes(truth, rivals, rotation, reachable)
    node = nearest_points(truth.directions, reachable.directions @ rotation)[1]
    telling = reachable.directions[tells[node]]
    if len(telling) == 0:
        return float("inf")
    if tells[nearest_points(truth.directions, (start @ rotation)[None])[1][0]]:
        return 0.0
    closest = telling[int(np.argmin(angle_between(telling, start)))]
    way = np.concatenate([start[None], reachable.path(start, closest, np.radians(5.0))])
    return float(angle_between(way[1:], way[:-1]).sum())


@lru_cache(maxsize=4096)
def _difference(truth: AspectGraph, rival: AspectGraph) -> FloatArray:
    """(N,) how far each view of `truth` is from the most similar one of a rival; the same in every task."""
    descriptor = make_descriptor(PluginConfig(name=truth.descriptor, options=truth.descriptor_parameters))
    similarity = np.array([descriptor.similarity(feature, rival.features).max() for feature in truth.features])
    return 1.0 - similarity


def telling_nodes(
    truth: AspectGraph,
    rivals: Sequence[AspectGraph],
    rotation: FloatArray,
    reachable: ReachableViews,
) -> BoolArray:
    """(N,) bool: the nodes of `truth` at which it differs from what every rival can show from anywhere.

    A view tells them apart when the most similar view of any rival is at least half as different as at the reachable
    view where that difference is largest. Where no reachable view differs at all, none tells.
    """
    difference = np.full(len(truth.features), np.inf)
    for rival in rivals:
        difference = np.minimum(difference, _difference(truth, rival))
    shown = np.unique(nearest_points(truth.directions, reachable.directions @ rotation)[1])
    largest = difference[shown].max()
    tells: BoolArray = (difference >= TELLING_SHARE * largest) & (largest > 1e-6)
    return tells
