"""Path hypotheses: how they start, grow and lose their loops (section IV.A-C).

A path is kept as the node that was valid at each hit, h(p, e) of eq. 3. Path elements and hit counters (eq. 1) are the
runs of equal nodes and their lengths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from viewsep.geometry import angle_between
from viewsep.interpretation.candidates import Candidates
from viewsep.messages import Array, FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Hypotheses:
    """P paths over all candidates after H hits.

    `hits` (P, H) int32 node ids; `rotation` (P, 3, 3) transformation t_i of each path to the controlled path; `w0`,
    `w1` (radians), `w2` (P,) measures; `rating` (P,) mean 1-based position in the queues.
    """

    hits: Array
    rotation: FloatArray
    w0: FloatArray
    w1: FloatArray
    w2: FloatArray
    rating: FloatArray

    def take(self, index: Array) -> Hypotheses:
        """The hypotheses at `index`."""
        return Hypotheses(
            self.hits[index], self.rotation[index], self.w0[index], self.w1[index], self.w2[index], self.rating[index]
        )


def children_of(hits: Array, candidates: Candidates) -> tuple[Array, Array]:
    """Every path prolonged by its last node and by each neighbour: parents (C,) and nodes (C,)."""
    options = candidates.neighbours[hits[:, -1]]
    parent, column = np.nonzero(options >= 0)
    return parent, options[parent, column]


def most_similar_child(parent: Array, node: Array, similarity: FloatArray) -> Array:
    """Algorithm 1, line 8: for every parent the index of its child most similar to the view. `similarity` is (M,)."""
    order = np.lexsort((-similarity[node], parent))
    first = np.ones(len(order), bool)
    first[1:] = parent[order][1:] != parent[order][:-1]
    return order[first]


def grow(hits: Array, parent: Array, node: Array, *, loop_free: bool) -> Array:
    """(C, H+1) paths: `hits[parent]` with `node` appended.

    With `loop_free` a path that returns to a node loses the loop; the hits of the loop go to that node (section IV.C).
    """
    grown = np.concatenate([hits[parent], node[:, None]], axis=1)
    if loop_free:
        returned = np.logical_or.accumulate(grown == node[:, None], axis=1)
        grown = np.where(returned, node[:, None], grown)
    return grown


def without_loop(controlled: FloatArray, spacing_rad: float) -> FloatArray:
    """The controlled path (H, 3) with its last loop removed, as it is from the hypotheses.

    The paper restricts the movement to be loop-free; on a long search it is not, and hypotheses that lost their loops
    could not follow it any more. A loop closes where the path comes back within half a node spacing of itself after
    two spacings or more; its hits go to the view it returns to.
    """
    returned = angle_between(controlled, controlled[-1]) < 0.5 * spacing_rad
    steps = angle_between(controlled[1:], controlled[:-1])
    length_since = np.append(steps[::-1].cumsum()[::-1], 0.0)
    returned &= length_since > 2.0 * spacing_rad
    if not returned.any():
        return controlled
    cut = controlled.copy()
    cut[int(np.argmax(returned)) :] = controlled[-1]
    return cut


def path_elements(hits: Array) -> Array:
    """(C, H) bool: True where a new path element begins."""
    begins = np.ones(hits.shape, bool)
    np.not_equal(hits[:, 1:], hits[:, :-1], out=begins[:, 1:])
    return begins


def distinct_paths(hits: Array, w1: FloatArray) -> Array:
    """Indices of paths (C, H) that differ in their sequence of nodes; of equal ones that with the best timing (w1)."""
    path, hit = np.nonzero(path_elements(hits))  # far fewer elements than hits
    first_element = np.searchsorted(path, np.arange(len(hits)))
    ordinal = np.arange(len(path)) - first_element[path]
    weights = np.random.default_rng(0).integers(1, 2**62, size=(hits.shape[1],))
    sequence = np.add.reduceat((hits[path, hit] + 1) * weights[ordinal], first_element)
    order = np.argsort(w1, kind="stable")
    _, first = np.unique(sequence[order], return_index=True)
    return np.sort(order[first])
