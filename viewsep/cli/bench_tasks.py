"""Options that say which objects an experiment separates, shared by its commands, and the tasks they mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from viewsep.bench.tasks import (
    TWINS,
    Pair,
    SeparationTask,
    draw_tasks,
    generated_pairs,
    objects_in,
    pairs_from,
    pool_of,
)
from viewsep.config import Config
from viewsep.errors import BadInput
from viewsep.sim.view_set import is_view_set

PairsFile = Annotated[
    Path | None, typer.Option(help="CSV with columns a,b: look-alikes, as paths relative to the file.")
]
ObjectsFolder = Annotated[Path | None, typer.Option(help="Folder of objects: meshes or view sets, one folder each.")]
Twins = Annotated[
    str | None, typer.Option(help=f"Generated boxes and their twins: {', '.join(TWINS)}.", show_default="face")
]
Runs = Annotated[int, typer.Option(min=1, help="Tasks; pairs and truths take turns.")]
Candidates = Annotated[int, typer.Option(min=2, help="Candidates of a task, the truth among them.")]
UnknownFraction = Annotated[float, typer.Option(min=0, max=1, help="Share of tasks whose object is no candidate.")]
Views = Annotated[int, typer.Option(min=12, max=2000, help="Views of a mesh's model.")]
Turned = Annotated[
    bool,
    typer.Option(
        "--turned",
        help="Models' views in other places for every object, as where each was learned as it happened to stand: what "
        "they err by between their views does not cancel then.",
    ),
]
Every = Annotated[
    int,
    typer.Option(min=1, help="Every how many photos of a view set one is for the model; the rest are for tests."),
]


@dataclass(frozen=True)
class Asked:
    """The tasks that were asked for, and all objects."""

    tasks: list[SeparationTask]
    pool: list[str]
    about: dict[str, Any]


def asked(
    pairs: Path | None,
    objects: Path | None,
    twins: str | None,
    runs: int,
    seed: int,
    candidates: int,
    unknown_fraction: float,
) -> Asked:
    """The tasks, and what a report says about them. Raises BadInput."""
    look_alikes, pool = _objects(pairs, objects, twins, seed)
    tasks = draw_tasks(look_alikes, pool, runs, seed, candidates, unknown_fraction)
    about = {
        "objects": pool,
        "runs": runs,
        "seed": seed,
        "candidates": candidates,
        "unknown_fraction": unknown_fraction,
    }
    return Asked(tasks, pool, about)


def learned(pool: Sequence[str], views: int, every: int, turned: bool, config: Config) -> dict[str, Any]:
    """What a report says about models and configuration; `views` are None where all models are of photos."""
    photos = all(is_view_set(Path(source)) for source in pool)
    shown = {"views": None if photos else views, "every": every} | ({"turned": True} if turned else {})
    return shown | {"config": config.model_dump(mode="json")}


def _objects(pairs: Path | None, objects: Path | None, twins: str | None, seed: int) -> tuple[list[Pair], list[str]]:
    """Pairs to ask for (none: every object in turn) and all objects. Raises BadInput."""
    if sum(given is not None for given in (pairs, objects, twins)) > 1 and twins is not None:
        raise BadInput("--twins generates objects: leave out --pairs and --objects")
    if twins is not None and twins not in TWINS:
        raise BadInput(f"--twins {twins!r} is none of {', '.join(TWINS)}: choose one")
    if pairs is None and objects is None:
        look_alikes = generated_pairs(twins or TWINS[0], seed)
        return look_alikes, pool_of(look_alikes)
    look_alikes = pairs_from(pairs) if pairs else []
    pool = objects_in(objects) if objects else []
    return look_alikes, sorted({*pool, *pool_of(look_alikes)})
