"""Which objects, which candidates, which seeds: the tasks of an experiment, a function of its seed alone."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from viewsep.errors import BadInput
from viewsep.sim.source import is_object, object_name

Pair = tuple[str, str]
"""The sources of two look-alikes."""

TWINS = ("face", "sticker", "none")
GENERATED_OBJECTS = 10


@dataclass(frozen=True, slots=True)
class SeparationTask:
    """Task `index`: the rig holds `source`, called `truth`, and the engine knows the `candidates` (sources).

    `seed` decides grasp, start view, direction and disturbances. The truth is not among the candidates of a task that
    asks whether an unknown object is noticed.
    """

    index: int
    seed: int
    source: str
    truth: str
    candidates: tuple[str, ...]

    @property
    def known(self) -> bool:
        """Whether the truth is among the candidates."""
        return self.source in self.candidates

    @property
    def identical(self) -> bool:
        """Whether another candidate is a copy of the truth (`--twins none`): nothing can tell the two apart."""
        return any(source != self.source and _copied(source) == _copied(self.source) for source in self.candidates)


def _copied(source: str) -> str:
    """The source that this one is a copy of."""
    return source.removesuffix(":twin=none")


def draw_tasks(
    pairs: Sequence[Pair],
    pool: Sequence[str],
    runs: int,
    seed: int,
    candidates: int = 2,
    unknown_fraction: float = 0.0,
) -> list[SeparationTask]:
    """Task i asks for pair i mod n, its truth alternating from round to round, with seed `seed + i`.

    Without pairs the truths are the objects of the pool in turn. Further candidates are drawn from the pool until
    there are `candidates` of them; in a share of `unknown_fraction` of the tasks one of those takes the truth's place.
    Raises BadInput where the pool is too small for that, or an unknown object would have a copy among the candidates.
    """
    names = names_of(pool)
    spare = 1 if unknown_fraction > 0 else 0
    if len(pool) < candidates + spare:
        raise BadInput(
            f"--candidates {candidates}{' with --unknown-fraction' if spare else ''} needs {candidates + spare} "
            f"objects, but there are {len(pool)}: give more objects or fewer candidates"
        )
    tasks = []
    for index in range(runs):
        rng = np.random.default_rng([seed + index, 5])
        if pairs:
            pair = pairs[index % len(pairs)]
            turn = index // len(pairs) % 2
            truth, rivals = pair[turn], [pair[1 - turn]]
        else:
            truth, rivals = pool[index % len(pool)], []
        others = [source for source in pool if source != truth and source not in rivals]
        drawn = [others[i] for i in rng.permutation(len(others))]
        known = not rng.random() < unknown_fraction
        listed = ([truth] if known else []) + rivals + drawn
        chosen = listed[:candidates]
        in_order = tuple(source for source in pool if source in chosen)
        task = SeparationTask(index, seed + index, truth, names[truth], in_order)
        if task.identical and not task.known:
            raise BadInput(
                "--twins none with --unknown-fraction: an object whose copy is a candidate cannot be noticed as "
                "unknown; leave one of the two out"
            )
        tasks.append(task)
    return tasks


def names_of(sources: Sequence[str]) -> dict[str, str]:
    """Source -> object name. Raises BadInput when two objects would be called the same."""
    names: dict[str, str] = {}
    for source in sources:
        name = object_name(source)
        if name in names.values():
            other = next(s for s, n in names.items() if n == name)
            raise BadInput(f"{source} and {other} are both called {name!r}: rename one of the folders")
        names[source] = name
    return names


def pool_of(pairs: Sequence[Pair]) -> list[str]:
    """Every object of the pairs once, in alphabetical order."""
    return sorted({source for pair in pairs for source in pair})


def generated_pairs(twin: str, seed: int = 0, count: int = GENERATED_OBJECTS) -> list[Pair]:
    """Generated product boxes and their twins."""
    return [(source, f"{source}:twin={twin}") for source in generated_objects(seed, count)]


def generated_objects(seed: int = 0, count: int = GENERATED_OBJECTS) -> list[str]:
    """Generated product boxes."""
    return [f"generated:{seed + i}" for i in range(count)]


def objects_in(folder: Path) -> list[str]:
    """All objects in a folder: its sub-folders that hold a mesh or a view set. Raises BadInput where there are none."""
    if not folder.is_dir():
        raise BadInput(f"--objects {folder}: there is no such folder; name one whose sub-folders hold the objects")
    found = [str(path) for path in sorted(folder.iterdir()) if path.is_dir() and is_object(path)]
    if not found:
        raise BadInput(f"--objects {folder}: none of its sub-folders holds a mesh (OBJ) or a view set (views.csv)")
    return found


def pairs_from(path: Path) -> list[Pair]:
    """Pairs of look-alikes from a CSV with columns a and b, relative to its folder. Raises BadInput."""
    try:
        with path.open(encoding="utf-8", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise BadInput(f"cannot read the pairs {path}: {error}") from error
    if not rows or not {"a", "b"} <= set(rows[0]):
        raise BadInput(f"{path}: a list of pairs needs the columns a,b and at least one row")
    pairs = []
    for line, row in enumerate(rows, start=2):
        if not row["a"] or not row["b"]:
            raise BadInput(f"{path}, line {line}: a pair needs two names, found {row['a']!r} and {row['b']!r}")
        if row["a"] == row["b"]:
            raise BadInput(f"{path}, line {line}: {row['a']!r} is paired with itself; name two objects")
        pairs.append((str(path.parent / row["a"]), str(path.parent / row["b"])))
    return pairs
