"""What the pose filter can be set to, and what it remembers from look to look."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from pydantic import Field

from viewsep.interpretation.holding import Held
from viewsep.interpretation.posterior import Posterior
from viewsep.messages import Array, FloatArray


@dataclass(frozen=True, slots=True)
class FilterOptions:
    """Settings of the pose filter.

    `rotations` is the size of the grid; `independent_after_deg` how far apart on a path looks count as about one each;
    `confidence` the probability at which a candidate is named, if it keeps that of `corroborated` without the looks
    from any one place; `unknown_prior` that of an object that is no candidate; `floor` how far below its candidate's
    best a rotation's log-probability may fall, so that a slip can be recovered from; a pose is known when its spread is
    below `pose_within_deg`; `motion_noise_deg` how far the object may turn in its holder, or the rig be wrong, between
    two independent looks; `followed` how many candidates' rotations are followed at once; `slips` how often a pose may
    be lost and searched anew. With `upright_within_deg` objects are expected to stand as they were learned: leaning no
    further than that from the rig's z axis, as on a turntable.
    """

    rotations: Annotated[int, Field(ge=1000, le=200_000)] = 12_000
    independent_after_deg: Annotated[float, Field(gt=0, le=90)] = 10.0
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.99
    corroborated: Annotated[float, Field(ge=0, lt=1)] = 0.8
    unknown_prior: Annotated[float, Field(ge=0, lt=1)] = 0.05
    floor: Annotated[float, Field(gt=1, le=200)] = 25.0
    pose_within_deg: Annotated[float, Field(gt=0, le=90)] = 12.0
    motion_noise_deg: Annotated[float, Field(ge=0, le=45)] = 1.0
    followed: Annotated[int, Field(ge=2, le=10_000)] = 24
    slips: Annotated[int, Field(ge=0, le=100)] = 3
    upright_within_deg: Annotated[float, Field(ge=5, le=180)] = 180.0


@dataclass(frozen=True, eq=False, slots=True)
class Lost:
    """The evidence `told` (nats) against candidate `who` (-1: nobody), held in `rotation` (3, 3), at the slip."""

    who: int = -1
    rotation: FloatArray = field(default_factory=lambda: np.eye(3))
    told: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class FilterState:
    """The posterior, and what it was made of since the pose was searched last.

    `prior` (K + 1,) are the probabilities of the candidates and of none of them then; `looks` (L, M) projected,
    their `views` (L, 3) and `shares` (L,) of evidence, so that a parked candidate can be taken up again; `gains`
    (L, K + 1) by how much each look raised the logarithms of the probabilities, up to a constant. `calm` is the
    probability that looks are as clean as the models' views; `settled` says that a pose was known; `slips` counts how
    often it was lost since, and `lost` who was held how then; `held` is how the candidates were held when that was
    known last.
    """

    posterior: Posterior
    prior: FloatArray
    looks: Array
    views: FloatArray
    shares: FloatArray
    gains: Array
    calm: float = 0.5
    settled: bool = False
    slips: int = 0
    count: int = 0
    held: Held = field(default_factory=Held)
    lost: Lost = field(default_factory=Lost)
