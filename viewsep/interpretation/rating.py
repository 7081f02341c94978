"""The measures w0, w1, w2 and the queues that combine them without regard to their values (section IV.B-D)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from viewsep.interpretation.hypotheses import path_elements
from viewsep.messages import Array, FloatArray


def path_course(hits: Array, rotation: FloatArray, directions: FloatArray, controlled: FloatArray) -> FloatArray:
    """w1 (eq. 3): mean angle in radians between transformed path (C, H) and controlled path (H, 3), hit by hit."""
    count, length = hits.shape
    # (H, C, 3): Rᵀ c for every path, as one product of two flat matrices
    in_object_frame = (controlled @ rotation.transpose(1, 0, 2).reshape(3, 3 * count)).reshape(length, count, 3)
    cosine = np.einsum("hct,hct->hc", in_object_frame, directions[hits.T])
    np.minimum(cosine, 1.0, out=cosine)
    np.maximum(cosine, -1.0, out=cosine)
    course: FloatArray = np.arccos(cosine, out=cosine).mean(axis=0)
    return course


def accumulated_similarity(hits: Array, best_similarity: FloatArray) -> FloatArray:
    """w2 (eq. 4): mean over a path's elements (C, H) of the best similarity (M,) ever seen at their nodes."""
    begins = path_elements(hits)
    accumulated: FloatArray = (best_similarity[hits] * begins).sum(axis=1) / begins.sum(axis=1)
    return accumulated


def queue_positions(values: FloatArray) -> FloatArray:
    """1-based positions (C,) in a priority queue, smallest value first; equal values share the first of their places.

    Hypotheses that end in the same node tie in w0, and twins tie wherever they look the same: neither is worse for it.
    """
    position: FloatArray = np.searchsorted(np.sort(values), values, side="left") + np.float64(1.0)
    return position


def mean_position(queues: Sequence[FloatArray]) -> FloatArray:
    """Overall rating: the mean position over one queue per measure (smaller values are better in each)."""
    rating: FloatArray = np.mean([queue_positions(values) for values in queues], axis=0)
    return rating


def best_per_candidate(rating: FloatArray, tie: FloatArray, owner: Array, count: int) -> Array:
    """Indices of the `count` best-rated hypotheses of every candidate, ordered by candidate, rating and `tie`."""
    order = np.lexsort((tie, rating, owner))
    sorted_owner = owner[order]
    first = np.searchsorted(sorted_owner, sorted_owner, side="left")
    return order[np.arange(len(order)) - first < count]
