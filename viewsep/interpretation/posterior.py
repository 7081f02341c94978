"""The probability of every candidate and rotation, and how a look changes it (design section 5)."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree
from scipy.special import logsumexp

from viewsep.geometry import nearest_rotation
from viewsep.interpretation.rotation_grid import rotation_grid
from viewsep.interpretation.view_cells import cell_of
from viewsep.messages import Array, FloatArray

NEIGHBOURS = 6  # of a rotation, that probability leaks to
FURTHEST = 200.0  # that a candidate's logarithm falls below the best one's
KEPT = 200  # views whose cells are kept
NEGLIGIBLE = 21.0  # below the best logarithm: 12,000 such rotations together weigh less than 1e-5
MODE_RAD = np.radians(25.0)  # around the best rotation: the rest are other ways to hold it


@dataclass(frozen=True, eq=False)
class Posterior:
    """Logarithms of probabilities that sum to 1 over all candidates and `none` of them.

    `active` (A,) are the candidates whose rotations are followed, in order, `log_p` (A, G) float32; `parked` (K,) are
    estimates of the others' probabilities, -inf for active ones. `evidence` is what was taken off all of them so that
    they sum to 1.
    """

    active: Array
    log_p: Array
    parked: FloatArray
    none: float
    evidence: float = 0.0

    @cached_property
    def log_mass(self) -> FloatArray:
        """(A,) logarithms of the probabilities of the active candidates."""
        best = self.log_p.max(axis=1)
        mass = np.exp(self.log_p - best[:, None]).sum(axis=1, dtype=np.float64)
        return np.asarray(best + np.log(mass))

    def likely(self, candidate: int) -> tuple[Array, Array]:
        """The rotations (N,) of an active candidate that weigh anything, and their logarithms (N,)."""
        log_p = self.log_p[np.searchsorted(self.active, candidate)]
        likely = np.flatnonzero(log_p > log_p.max() - NEGLIGIBLE)
        return likely, log_p[likely]

    def probabilities(self) -> FloatArray:
        """(K,) of all candidates."""
        return np.asarray(np.exp(self.log_shares()[:-1]))

    def log_shares(self) -> FloatArray:
        """(K + 1,) logarithms of all candidates' probabilities, and that of none of them."""
        log = np.append(self.parked, self.none)
        log[self.active] = self.log_mass
        return log

    def normalised(self, floor: float) -> Posterior:
        """The same with a sum of 1.

        A rotation's logarithm falls no further than `floor` below the best one of its candidate, so that a slip can be
        recovered from, and a candidate's best no further than FURTHEST below the best of all. Between that one and none
        of them lies no more than `floor` either.
        """
        best = self.log_p.max(axis=1, keepdims=True)
        top = float(best.max())
        raised = np.maximum(best, np.float32(top - FURTHEST)) - best
        log_p = np.maximum(self.log_p, best - np.float32(floor)) + (raised - np.float32(top))
        none = float(np.clip(self.none - top, -floor, floor)) if np.isfinite(self.none) else self.none
        parked = self.parked - top
        log_total = _log_sum(Posterior(self.active, log_p, parked, none).log_shares())
        return Posterior(
            self.active,
            log_p - np.float32(log_total),
            parked - log_total,
            none - log_total,
            self.evidence + top + log_total,
        )

    def times(self, likelihood: Array, cells: Array, parked: FloatArray, none: float) -> Posterior:
        """Multiplied with a look's (A, CELLS) log-likelihoods at the rotations' `cells` (G,), and those of the rest."""
        return replace(
            self,
            log_p=self.log_p + np.take(likelihood, cells, axis=1),
            parked=self.parked + parked,
            none=self.none + none,
        )

    def diffused(self, share: float, grid: int) -> Posterior:
        """Every rotation gives a `share` of its probability to its neighbours: where the object is, is not exact."""
        if share <= 0.0:
            return self
        best = self.log_p.max(axis=1, keepdims=True)
        p = np.exp(self.log_p - best)
        around = np.stack([_adjacency(grid) @ row for row in p])
        mixed = (1.0 - np.float32(share)) * p + np.float32(share / NEIGHBOURS) * around
        mixed *= p.sum(axis=1, keepdims=True) / mixed.sum(axis=1, keepdims=True)  # being a neighbour is not mutual
        return replace(self, log_p=np.log(mixed + np.float32(1e-30)) + best)


def _log_sum(log: FloatArray) -> float:
    """Of numbers whose logarithms are (N,); scipy's does the same in ten times the time."""
    best = int(np.argmax(log))
    others = np.exp(log - log[best])
    others[best] = 0.0
    return float(log[best] + np.log1p(others.sum()))


@cache
def neighbours_of(grid: int) -> Array:
    """(NEIGHBOURS, G) the rotations next to each of the grid's, the nearest ones first."""
    flat = rotation_grid(grid).reshape(grid, 9)
    near = np.asarray(cKDTree(flat).query(flat, k=NEIGHBOURS + 1)[1])[:, 1:]
    return np.ascontiguousarray(near.T)


@cache
def _adjacency(grid: int) -> csr_matrix[np.float32]:
    """(G, G) one where a rotation (column) is next to another (row)."""
    next_to = neighbours_of(grid).T
    ones = np.ones(next_to.size, np.float32)
    return csr_matrix((ones, next_to.ravel(), np.arange(0, next_to.size + 1, NEIGHBOURS)), shape=(grid, grid))


@cache
def spacing_rad_of(grid: int) -> float:
    """The mean angle from a rotation of the grid to the next one."""
    rotations = rotation_grid(grid)
    trace = np.einsum("gij,gij->g", rotations, rotations[neighbours_of(grid)[0]])
    return float(np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0)).mean())


class RotationGrid:
    """The grid's rotations, and where each of them sees the object from."""

    def __init__(self, count: int) -> None:
        self.rotations = rotation_grid(count)
        columns = self.rotations.transpose(1, 2, 0).reshape(3, -1)
        self._columns = np.ascontiguousarray(columns, np.float32)  # c @ this is every u = R^T c
        self._cells: dict[bytes, Array] = {}
        self._flat = self.rotations.reshape(count, 9).astype(np.float32)

    def log_prior(self, leaning_rad: float, floor: float) -> FloatArray:
        """(G,) logarithms of probabilities that sum to 1, the same for all rotations that lean no more than that.

        The object's z axis then leans from the control frame's. Others are less probable by `floor`, not impossible.
        """
        leans = self.rotations[:, 2, 2] < np.cos(leaning_rad) - 1e-9
        log = np.where(leans, -floor, 0.0)
        return np.asarray(log - logsumexp(log))

    def cells(self, view: FloatArray) -> Array:
        """(3,) -> (G,) the cell each rotation sees the object's sphere in; those of the latest views are kept."""
        key = view.tobytes()
        if key not in self._cells:
            x, y, z = (view.astype(np.float32) @ self._columns).reshape(3, -1)
            if len(self._cells) >= KEPT:
                del self._cells[next(iter(self._cells))]
            self._cells[key] = cell_of(x, y, z)
        return self._cells[key]

    def pose(self, likely: Array, log_p: Array) -> tuple[FloatArray, float]:
        """Rotations (N,) and their logarithms -> the mean around the best (3, 3), the mean squared angle to it."""
        flat = np.take(self._flat, likely, axis=0)
        best = int(np.argmax(log_p))
        weight = np.exp(log_p - log_p[best]).astype(np.float64)
        cosine = flat @ flat[best]  # trace(A^T B) = 1 + 2 cos
        near = np.flatnonzero((cosine > 1.0 + 2.0 * np.cos(MODE_RAD)) & (weight > 1e-4))
        mean = nearest_rotation(np.tensordot(weight[near], self.rotations[likely[near]], 1))
        trace = flat @ mean.ravel().astype(np.float32)
        angle = np.arccos(np.clip((trace - 1.0) / 2.0, -1.0, 1.0))
        spread = float(weight @ (angle * angle) / weight.sum())
        half_a_step = 0.5 * spacing_rad_of(len(self.rotations))
        return mean, spread + half_a_step**2
