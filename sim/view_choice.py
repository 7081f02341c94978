"""Which photos of a view set become the nodes of a model."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from viewsep.errors import BadInput
from viewsep.sim.view_set import ViewSet


def every_kth(view_set: ViewSet, k: int) -> list[int]:
    """Indices of every `k`-th listed view that is no trial, from the first on. Raises BadInput for `k` below 1."""
    if k < 1:
        raise BadInput(f"--every {k}: use 1 for all photos, 2 for every second one, and so on")
    return [int(index) for index in np.flatnonzero(~view_set.trial)[::k]]


def named_views(view_set: ViewSet, path: Path) -> list[int]:
    """Indices of the views named in a text file, one image per line, `#` begins a comment; in the set's order.

    Raises BadInput for a file that cannot be read or names nothing, and for unknown or repeated names.
    """
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"cannot read the list of nodes {path}: {error}") from error
    first: dict[str, int] = {}
    for number, line in enumerate(lines, start=1):
        name = line.split("#")[0].strip()
        if not name:
            continue
        if name not in view_set.images:
            raise BadInput(
                f"{path}, line {number}: {view_set.folder} lists no image {name!r}; write names as they stand there, "
                f"e.g. {view_set.images[0]}"
            )
        if name in first:
            raise BadInput(f"{path}, line {number}: {name!r} is in line {first[name]} already; name each image once")
        first[name] = number
    if not first:
        raise BadInput(f"{path}: names no images; write one per line")
    return [index for index, name in enumerate(view_set.images) if name in first]
