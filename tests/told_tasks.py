"""Recordings of tasks that never took place, quick to make: random models, percepts along an arc, any ending."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from seed_method import seed_config

from viewsep.descriptors.cch import ColourCooccurrence
from viewsep.geometry import delaunay_edges, equidistant_sphere, great_circle
from viewsep.messages import Array, Frame, Message, MoveSettled, Percept, PerceptReceived, TaskStarted
from viewsep.models.aspect_graph import AspectGraph, Provenance
from viewsep.recording import task_recorder
from viewsep.recordings.reader import Recording, read_recording

DESCRIPTOR = ColourCooccurrence()
VIEWS = 30


def model(name: str, seed: int, views: int = VIEWS, *, directions: Array | None = None) -> AspectGraph:
    """A model of `views` views that look like nothing, the same for the same seed."""
    rng = np.random.default_rng(seed)
    features = rng.random((views, DESCRIPTOR.size), np.float32)
    directions = equidistant_sphere(views, 30) if directions is None else directions
    return AspectGraph(
        name=name,
        directions=directions,
        edges=delaunay_edges(directions),
        features=features / features.sum(axis=1, keepdims=True),
        thumbnails=rng.integers(0, 256, (views, 12, 10, 3), np.uint8),
        descriptor=DESCRIPTOR.name,
        descriptor_parameters=DESCRIPTOR.parameters,
        provenance=Provenance("nowhere", "0", "test"),
    )


def way(count: int) -> list[Message]:
    """A task with `count` percepts seen along an arc, with a picture for each."""
    rng = np.random.default_rng(5)
    start, end = np.array([1.0, 0.0, 0.0]), np.array([-0.6, 0.0, 0.8])
    seen: list[Message] = [TaskStarted(0, 3, start), MoveSettled(1, 0)]
    shown = model("shown", 1).features
    for i, view in enumerate(great_circle(start, end, float(np.radians(8)))[:count]):
        picture = rng.integers(0, 256, (48, 64, 3), np.uint8)
        seen.append(Frame(10 + i, i, picture, None))
        seen.append(PerceptReceived(Percept(10 + i, i, DESCRIPTOR.name, shown[i % VIEWS], view)))
    return seen


def record(
    path: Path, heard: Sequence[Message], candidates: int = 2, truth: str = "object_0", names: Sequence[str] = ()
) -> Recording:
    """The recording of what was heard, with one random model a name, or so many candidates."""
    names = names or [f"object_{i}" for i in range(candidates)]
    models = [model(name, i + 1) for i, name in enumerate(names)]
    with task_recorder(path, seed_config(), models, 3, truth) as recorder:
        for stamp_ns, message in enumerate(heard):
            recorder.hear(stamp_ns, message)
    return read_recording(path)
