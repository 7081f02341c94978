"""All candidates' aspect graphs as one set of nodes, so that one vectorised pass serves them all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from viewsep.errors import BadInput
from viewsep.messages import Array, FloatArray
from viewsep.models.aspect_graph import AspectGraph


@dataclass(frozen=True, eq=False, slots=True)
class Candidates:
    """K candidates with M nodes together.

    `directions` (M, 3) float64, `features` (M, D) float32, `neighbours` (M, J) int32 (column 0 the node itself, -1 is
    padding), `owner` (M,) int32 the candidate a node belongs to, `spacing_rad` the mean angle between neighbours.
    """

    names: tuple[str, ...]
    directions: FloatArray
    features: Array
    neighbours: Array
    owner: Array
    spacing_rad: float

    @staticmethod
    def of(models: Sequence[AspectGraph]) -> Candidates:
        """Stack models. Raises BadInput when there is none, or their descriptors differ."""
        if not models:
            raise BadInput("no candidates: name at least one model")
        first = models[0]
        for model in models[1:]:
            same = model.descriptor == first.descriptor and model.descriptor_parameters == first.descriptor_parameters
            if not same:
                raise BadInput(
                    f"models {first.name!r} and {model.name!r} were learned with different descriptors "
                    f"({first.descriptor} {first.descriptor_parameters}, {model.descriptor} "
                    f"{model.descriptor_parameters}): learn them again with the same one"
                )
        tables = [model.neighbours() for model in models]
        width = max(table.shape[1] for table in tables)
        starts = np.cumsum([0, *(len(table) for table in tables)])
        stacked = [
            np.pad(np.where(table >= 0, table + start, -1), ((0, 0), (0, width - table.shape[1])), constant_values=-1)
            for table, start in zip(tables, starts, strict=False)
        ]
        return Candidates(
            names=tuple(model.name for model in models),
            directions=np.concatenate([model.directions for model in models]),
            features=np.concatenate([model.features for model in models]),
            neighbours=np.concatenate(stacked).astype(np.int32),
            spacing_rad=float(np.mean([model.spacing_rad for model in models])),
            owner=np.repeat(np.arange(len(models), dtype=np.int32), [len(table) for table in tables]),
        )
