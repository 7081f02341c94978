"""How much a look is expected to tell about the candidate and its pose."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from viewsep.interfaces import PoseSamples
from viewsep.interpretation.contrast import expected
from viewsep.interpretation.independence import independent_share
from viewsep.interpretation.predictions import Predictions
from viewsep.interpretation.view_cells import cell_of
from viewsep.messages import Array, FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class Promise:
    """Bits that a look from each view is expected to give: `candidate` (V,), and `pose` (V,) of who is most likely."""

    candidate: FloatArray
    pose: FloatArray


def promised(predictions: Predictions, samples: PoseSamples, views: FloatArray) -> Promise:
    """What looks from (V, 3) views promise.

    The information is the entropy of the mixture of all samples' predictions less that of each candidate's own; the
    entropy of a mixture is estimated by the overlaps of its parts (Kolchinsky and Tracey 2017, with Bhattacharyya's).
    """
    shown, known = _shown(predictions, samples, views)
    overlap = _overlap(predictions, samples.owner, shown)
    weight = samples.weight / samples.weight.sum()
    owners, owner = np.unique(samples.owner, return_inverse=True)
    of_owner = np.where(owner == np.arange(len(owners))[:, None], weight, 0.0)  # (O, S)
    alike = overlap @ np.vstack([weight, of_owner]).T.astype(np.float32)  # (V, S, 1 + O)
    mixed = -np.log2(alike[..., 0]) @ weight
    own = -np.log2(alike[:, np.arange(len(owner)), 1 + owner] / of_owner.sum(axis=1)[owner])
    of_leader = of_owner[np.argmax(of_owner.sum(axis=1))]
    share = independent_share(views, samples.seen, samples.independent_rad) * (known @ weight)
    candidate: FloatArray = share * np.maximum(mixed - own @ weight, 0.0)
    pose: FloatArray = share * np.maximum(own @ of_leader / of_leader.sum(), 0.0)
    return Promise(candidate, pose)


def _shown(predictions: Predictions, samples: PoseSamples, views: FloatArray) -> tuple[Array, FloatArray]:
    """(V, S, M) what each sample predicts from each view, and (V, S) 1 where its model has a view close by, else 0."""
    seen = views @ samples.rotation  # (S, V, 3)
    cells = cell_of(*np.moveaxis(seen, 2, 0)).T
    shown = np.empty((len(views), len(samples.owner), predictions.dimensions), np.float32)
    known = np.empty((len(views), len(samples.owner)))
    for k in np.unique(samples.owner):
        mine = np.flatnonzero(samples.owner == k)
        shown[:, mine] = predictions.prediction(int(k), cells[:, mine])
        known[:, mine] = predictions.known(int(k), cells[:, mine])
    return shown, known


def _overlap(predictions: Predictions, owner: Array, shown: Array) -> FloatArray:
    """(V, S, S) in (0, 1]: how alike looks at two samples would be; 1 when they cannot be told apart.

    Models whose views lie in different places err independently: between them a look tells what it will count for, with
    the error that this will be taken to have.
    """
    half_way = (-0.5 * shown) @ shown.transpose(0, 2, 1)  # squared distances to the middle between two, by and by
    norm2 = -0.5 * np.diagonal(half_way, axis1=1, axis2=2)
    half_way += norm2[:, :, None]
    half_way += norm2[:, None, :]
    np.maximum(half_way, 0.0, out=half_way)
    each = np.arange(half_way.shape[1])
    half_way[:, each, each] = 0.0
    calm, disturbed = (np.exp(predictions.temper * law.log_share(half_way)) for law in predictions.laws)
    overlap: Array = 0.5 * (calm + disturbed)
    layout = predictions.layout[owner]
    err = layout[:, None] != layout
    if err.any():
        told = expected(predictions, 4.0 * half_way[:, err])
        overlap[:, err] = np.exp(-0.5 * told**2 / max(predictions.log_error2, 1e-12))
    return overlap
