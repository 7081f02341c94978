"""What a candidate is expected to show where it was not learned: what its look-alike shows there.

A twin that is seen from a side that was learned of the other one only must not be taken for that one.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

from viewsep.interpretation.overlay import everywhere, overlays
from viewsep.interpretation.predictions import Loan, Predictions
from viewsep.interpretation.view_cells import CELLS, cell_areas, cell_directions, cell_of
from viewsep.messages import BoolArray, FloatArray
from viewsep.models.aspect_graph import AspectGraph

GAP = 0.01  # of the sphere: with less unlearned a candidate counts as known from everywhere
ALIKE = 1.0 / 3.0  # of what two look-alikes show they have in common
ASKED = 16  # views of a candidate: where a look-alike shows none of them it is none
STRIP = 0.7  # of the angle between views: the tilt between two rings is as vague, and shows strips beside them
MOST = 3  # look-alikes that are laid over a candidate


@lru_cache(maxsize=2)
def predictions_of(models: tuple[AspectGraph, ...]) -> Predictions:
    """Those of these models, shared by interpreter and planner."""
    predictions = Predictions(models)
    loans = [loan for k, model in enumerate(models) for loan in loans_to(predictions, k, model.spacing_rad)]
    return predictions.borrowing(loans) if loans else predictions


def loans_to(predictions: Predictions, k: int, spacing_rad: float) -> Iterator[Loan]:
    """What look-alikes lend to candidate k, whose views are `spacing_rad` apart, the most alike one first."""
    known = predictions.known(k, np.arange(CELLS))
    if cell_areas()[~known].sum() <= GAP:
        return
    laid_over = []
    for other in predictions.resembling(k, ASKED)[:MOST]:
        for rotation in overlays(predictions, k, other)[:1]:
            laid_over.append((_likeness(predictions, k, other, rotation), other, rotation))
    alike = [one for one in laid_over if one[0] >= ALIKE]
    for _, other, rotation in sorted(alike, key=lambda one: -one[0]):
        at = cell_of(*(cell_directions() @ rotation.T).T)
        cells = np.flatnonzero(_wide(~known & predictions.known(other, at), STRIP * spacing_rad))
        if len(cells):
            yield Loan(k, other, cells, at[cells])
            known[cells] = True


def _likeness(predictions: Predictions, k: int, other: int, rotation: FloatArray) -> float:
    """The share of what both show that looks could take for either, the other one turned by `rotation` (3, 3)."""
    (shown, known), (others, others_known) = everywhere(predictions, k), everywhere(predictions, other)
    at = cell_of(*(cell_directions() @ rotation.T).T)
    distance2 = ((shown - others[at]) ** 2).sum(axis=1)
    both, alike = known & others_known[at], predictions.log_of_distance2(distance2, 0.5) > predictions.log_of_others
    return float(cell_areas()[both & alike].sum() / max(cell_areas()[both].sum(), 1e-12))


def _wide(cells: BoolArray, within_rad: float) -> BoolArray:
    """(CELLS,) only those that lie in or next to a cap of that radius in them: narrower strips are left out."""
    if cells.all():
        return cells
    middles = cell_directions()
    to_edge = np.asarray(cKDTree(middles[~cells]).query(middles)[0])
    inside: BoolArray = to_edge > 2.0 * np.sin(0.5 * within_rad)
    if not inside.any():
        return inside
    to_inside = np.asarray(cKDTree(middles[inside]).query(middles)[0])
    wide: BoolArray = cells & (to_inside <= 2.0 * np.sin(within_rad))
    return wide
