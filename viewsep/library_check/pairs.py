"""How hard two objects are to tell apart: from which views one look does it, how far away those are, on which rig."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from viewsep.geometry import angle_between, unit
from viewsep.interpretation.rotation_grid import rotation_grid
from viewsep.interpretation.view_cells import cell_areas, cell_directions, cell_of
from viewsep.library_check.alignment import Alignment, Candidates, alignments
from viewsep.messages import BoolArray, FloatArray
from viewsep.planning.reachable import ReachableViews

CONFUSED = 0.05  # a look tells two objects apart when it shows the wrong one as the likelier at most that often
TELLING_BITS = 1.0 - float(np.log2(1.0 + 2.0 * CONFUSED))
LEAST_BITS = 0.02  # views that promise less are not worth a move: as the planner's
NEXT_RAD = np.radians(6.0)  # telling views closer than that belong to the same place
PLACES, BEST_VIEWS = 3, 3
APART_RAD = np.radians(30.0)  # between best views
EDGE = 0.95  # of a place lie within its radius
ASKED, FEWEST_POSES, MOST_POSES = 400_000, 150, 1000  # views times poses that a rig is judged by


@dataclass(frozen=True, eq=False, slots=True)
class Place:
    """A region of telling views around `centre` (3,) in the first object's frame, and its share of all views."""

    centre: FloatArray
    radius_rad: float
    share: float


@dataclass(frozen=True, slots=True)
class OnRig:
    """How poses of the object in the rig's holder fare, shares of all of them.

    `told`: some reachable view tells the two apart; `hopeless`: no reachable view says anything.
    """

    told: float
    hopeless: float


@dataclass(frozen=True, eq=False, slots=True)
class Pair:
    """Two objects in the pose in which they are most alike.

    `bits` is what a look from anywhere tells on average, `best_bits` from the best view; `telling` the share of the
    views from which one look tells them apart, `furthest_rad` the way to the next of those from anywhere, infinite
    without any. `alignment` is None where the models have too few views in common to be compared.
    """

    first: str
    second: str
    bits: float
    best_bits: float
    telling: float
    furthest_rad: float
    places: tuple[Place, ...]
    best_views: FloatArray
    on_rig: OnRig | None
    alignment: Alignment | None


class RigPoses:
    """Poses of an object in a rig's holder, spread evenly, and the cells of its sphere that the rig shows in each."""

    def __init__(self, reachable: ReachableViews) -> None:
        count = int(np.clip(ASKED // len(reachable.directions), FEWEST_POSES, MOST_POSES))
        seen = np.einsum("gji,vj->gvi", rotation_grid(count), reachable.directions)
        self.cells = cell_of(*np.moveaxis(seen, 2, 0))

    def judged(self, found: Sequence[Alignment]) -> OnRig:
        """The most that any reachable view tells, in the worst of the poses in which the two are most alike."""
        best = np.min([np.nan_to_num(one.bits)[self.cells].max(axis=1) for one in found], axis=0)
        return OnRig(float(np.mean(best >= TELLING_BITS)), float(np.mean(best < LEAST_BITS)))


def pair_of(candidates: Candidates, first: int, second: int, rig: RigPoses | None) -> Pair:
    """What there is to say of two candidates."""
    found, names = alignments(candidates, first, second), candidates.names
    if not found:
        nowhere = np.empty((0, 3))
        return Pair(names[first], names[second], np.nan, np.nan, np.nan, np.inf, (), nowhere, None, None)
    alike = found[0]
    bits = np.nan_to_num(alike.bits)
    tells = bits >= TELLING_BITS
    known = ~np.isnan(alike.bits)
    middles = cell_directions()
    furthest = np.inf
    if tells.any():
        chords = np.asarray(cKDTree(middles[tells]).query(middles[known])[0])
        furthest = float(2.0 * np.arcsin(np.clip(0.5 * chords.max(), 0.0, 1.0)))
    return Pair(
        first=names[first],
        second=names[second],
        bits=alike.mean,
        best_bits=float(bits.max()),
        telling=float(cell_areas()[tells].sum() / cell_areas()[known].sum()),
        furthest_rad=furthest,
        places=places_of(tells),
        best_views=_best_views(bits),
        on_rig=rig.judged(found) if rig else None,
        alignment=alike,
    )


def pairs_of(candidates: Candidates, rig: RigPoses | None = None) -> Iterator[Pair]:
    """All pairs of the candidates, in their order."""
    count = len(candidates.names)
    for first in range(count):
        for second in range(first + 1, count):
            yield pair_of(candidates, first, second, rig)


def by_difficulty(pairs: Sequence[Pair]) -> list[Pair]:
    """The hardest first; those that cannot be compared last."""
    return sorted(pairs, key=lambda pair: (np.isnan(pair.bits), pair.bits, pair.first, pair.second))


def places_of(tells: BoolArray) -> tuple[Place, ...]:
    """Where (CELLS,) telling cells lie: the largest connected places, at most three."""
    where = np.flatnonzero(tells)
    if len(where) == 0:
        return ()
    at, area = cell_directions()[where], cell_areas()[where]
    near = cKDTree(at).query_pairs(2.0 * np.sin(0.5 * NEXT_RAD), output_type="ndarray")
    graph = csr_matrix((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(at), len(at)))
    label = np.asarray(connected_components(graph, directed=False)[1])
    found = [_place(at[label == part], area[label == part]) for part in range(int(label.max()) + 1)]
    return tuple(sorted(found, key=lambda place: -place.share)[:PLACES])


def _place(at: FloatArray, area: FloatArray) -> Place:
    mean = area @ at
    centre = unit(mean) if np.linalg.norm(mean) > 1e-9 else at[0]
    away = angle_between(at, centre)
    order = np.argsort(away)
    inside = np.searchsorted(np.cumsum(area[order]), EDGE * area.sum())
    return Place(centre, float(away[order][min(int(inside), len(at) - 1)]), float(area.sum()))


def _best_views(bits: FloatArray) -> FloatArray:
    """(B, 3) views that tell the most, apart from each other; each is the middle of what is as good around it."""
    middles = cell_directions()
    around = np.asarray(cKDTree(middles).query(middles, k=25)[1])
    smooth = bits[around].mean(axis=1)
    left = smooth.copy()
    chosen: list[FloatArray] = []
    while len(chosen) < BEST_VIEWS and left.max() >= max(LEAST_BITS, 0.9 * smooth.max()):
        chosen.append(middles[int(np.argmax(left))])
        left = np.where(angle_between(middles, chosen[-1]) < APART_RAD, 0.0, left)
    return np.array(chosen).reshape(-1, 3)
