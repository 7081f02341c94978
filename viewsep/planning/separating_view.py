"""The view that tells the candidates apart best, given their poses (section IV.E)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from viewsep.geometry import delaunay_edges, equidistant_sphere, nearest_points
from viewsep.messages import BoolArray, FloatArray
from viewsep.models.aspect_graph import AspectGraph

SIMILARITY_NODES = 100


@dataclass(frozen=True, eq=False, slots=True)
class SimilarityGraph:
    """How much the candidates differ, over directions of the common control frame.

    `directions` (S, 3); `variance` (S,) summed variance between the candidates' features; `smoothed` (S,) its mean
    over each node and its neighbours, which allows for pose errors; `known` (S,) whether all candidates have views
    there: where not, both are zero.
    """

    directions: FloatArray
    variance: FloatArray
    smoothed: FloatArray
    known: BoolArray


SIMILARITY_DIRECTIONS = equidistant_sphere(SIMILARITY_NODES)
_EDGES = delaunay_edges(SIMILARITY_DIRECTIONS)


def similarity_graph(models: Sequence[AspectGraph], rotations: FloatArray) -> SimilarityGraph:
    """Rotate the K candidates by their poses (K, 3, 3) object -> control and compare what they show everywhere.

    A candidate's nodes are associated with the closest node of the similarity graph; where none is, the candidate's
    closest node stands in, unless it is further away than that candidate's nodes are from each other.
    """
    associated = [_associated(model, rotation) for model, rotation in zip(models, rotations, strict=True)]
    known = np.logical_and.reduce([near for _, near in associated])
    variance = np.where(known, np.stack([shown for shown, _ in associated]).var(axis=0).sum(axis=1), 0.0)
    total, count = variance.copy(), np.ones(len(variance))
    for a, b in (_EDGES.T, _EDGES.T[::-1]):
        np.add.at(total, a, variance[b])
        np.add.at(count, a, known[b])
    return SimilarityGraph(SIMILARITY_DIRECTIONS, variance, np.where(known, total / count, 0.0), known)


def _associated(model: AspectGraph, rotation: FloatArray) -> tuple[FloatArray, BoolArray]:
    """(S, D) mean feature of the model's nodes at every node of the similarity graph, and (S,) whether any is near."""
    rotated = model.directions @ rotation.T
    nearest = nearest_points(SIMILARITY_DIRECTIONS, rotated)[1]
    total = np.zeros((len(SIMILARITY_DIRECTIONS), model.features.shape[1]))
    np.add.at(total, nearest, model.features)
    count = np.bincount(nearest, minlength=len(SIMILARITY_DIRECTIONS))
    empty = count == 0
    gap, closest = nearest_points(rotated, SIMILARITY_DIRECTIONS[empty])
    total[empty] = model.features[closest]
    near = ~empty
    near[empty] = gap <= 2.0 * np.sin(min(model.spacing_rad, np.pi) / 2.0)
    shown: FloatArray = total / np.maximum(count, 1)[:, None]
    return shown, near
