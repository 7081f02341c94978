"""What a user would try first: the same tasks and as many looks, on a fixed sweep, without the engine.

`nearest` believes the single look that resembles a stored view most, `vote` lets every look vote for the candidate with
the nearest stored view, `sift` counts local features that match a stored picture (Lowe's ratio test).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import cv2
import numpy as np

from viewsep.assembly import reachable_views
from viewsep.bench.journal import Row
from viewsep.bench.methods import RANDOM_MOTION
from viewsep.bench.setup import Setup
from viewsep.bench.summary import verdict
from viewsep.bench.tasks import SeparationTask
from viewsep.built_rig import SimulatedRig, disturbances_of
from viewsep.config import Config
from viewsep.errors import BadInput
from viewsep.geometry import angle_between, rotation_showing
from viewsep.learning import CAMERA_DIRECTION
from viewsep.messages import Array, FloatArray
from viewsep.planning.sweep import sweep
from viewsep.plugins import make_descriptor
from viewsep.sim.disturbances import constant_gains, disturbed

RATIO = 0.75  # of the distances to the best and the second-best match in a stored picture
Picture = tuple[Array, Array]
"""Image (H, W, 3) uint8 RGB and mask (H, W) bool."""
Scores = Callable[[SeparationTask, Sequence[Picture], Config, Setup], FloatArray]
"""(L, K) how much the looks until each one speak for each candidate; equal best scores decide nothing."""


def baseline_row(task: SeparationTask, name: str, looks: int, config: Config, setup: Setup) -> Row:
    """Take `looks` pictures on a fixed sweep and name the candidate the baseline scores highest."""
    held, views, pictures = exposed_sweep(task, looks, config, setup)
    scores = BASELINES[name](task, pictures, held.config, setup)[-1]
    best = np.flatnonzero(scores == scores.max())
    names = [setup.model(source, held.config).name for source in task.candidates]
    outcome, named = ("identified", names[best[0]]) if len(best) == 1 else ("undecided", "")
    return {
        "index": task.index,
        "seed": task.seed,
        "method": name,
        "truth": task.truth,
        "known": task.known,
        "identical": task.identical,
        "candidates": names,
        "unknown_probability": None,
        "outcome": outcome,
        "object": named,
        "verdict": verdict(outcome, named, task.truth, task.known, task.identical),
        "looks": len(views),
        "travel_deg": float(np.degrees(angle_between(views[1:], views[:-1]).sum())),
    }


def check_baselines(names: Sequence[str]) -> None:
    """Raises BadInput for a baseline that does not exist."""
    for name in names:
        if name not in BASELINES:
            known = ", ".join([*BASELINES, RANDOM_MOTION])
            raise BadInput(f"--baselines {name!r} is none of {known}: name one or several of them")


def exposed_sweep(
    task: SeparationTask, looks: int, config: Config, setup: Setup
) -> tuple[SimulatedRig, FloatArray, list[Picture]]:
    """The rig, at most `looks` views (L, 3) well spread over what it reaches, and what its camera would see from them.

    Disturbances are included.
    """
    held = setup.hold(task.source, config, task.seed)
    reachable = reachable_views(held.config.rig).directions
    start = reachable[np.random.default_rng(task.seed).integers(len(reachable))]  # where the planners start too
    views = sweep(reachable, start, looks)
    disturbances = disturbances_of(held.config.sim)
    camera, shown = held.rig.geometry.camera_direction, views @ held.true_rotation(0)
    pictures = setup.pictures(task.source, held.config)
    try:
        exposed = [
            disturbed(
                *pictures.render(camera, rotation_showing(view, camera)),
                disturbances,
                np.random.default_rng([task.seed, 4, exposure]),
                constant_gains(disturbances, task.seed),
            )
            for exposure, view in enumerate(shown)
        ]
    finally:
        pictures.close()
        held.rig.camera.close()
    return held, views, exposed


def _similarities(task: SeparationTask, pictures: Sequence[Picture], config: Config, setup: Setup) -> FloatArray:
    """(L, K) similarity of each look to the nearest stored view of each candidate."""
    descriptor = make_descriptor(config.descriptor)
    models = [setup.model(source, config) for source in task.candidates]
    features = [descriptor.describe(image, mask) for image, mask in pictures]
    return np.array([[descriptor.similarity(f, model.features).max() for model in models] for f in features])


def _nearest(task: SeparationTask, pictures: Sequence[Picture], config: Config, setup: Setup) -> FloatArray:
    return np.maximum.accumulate(_similarities(task, pictures, config, setup), axis=0)


def _vote(task: SeparationTask, pictures: Sequence[Picture], config: Config, setup: Setup) -> FloatArray:
    """Votes, and where they are equal the mean similarity."""
    similarity = _similarities(task, pictures, config, setup)
    votes = (similarity == similarity.max(axis=1, keepdims=True)).cumsum(axis=0)
    mean = similarity.cumsum(axis=0) / np.arange(1, len(similarity) + 1)[:, None]
    return np.asarray(votes + 0.5 * mean)


def _sift(task: SeparationTask, pictures: Sequence[Picture], config: Config, setup: Setup) -> FloatArray:
    """Matches in the stored picture of each candidate that matches a look best, summed over the looks."""
    galleries = [_gallery(source, config.model_dump_json(), setup) for source in task.candidates]
    scores = np.zeros((len(pictures), len(galleries)))
    for look, picture in enumerate(pictures):
        found = local_features(*picture)
        if len(found) > 0:
            scores[look] = [matches(found, gallery).max(initial=0) for gallery in galleries]
    return scores.cumsum(axis=0)


@lru_cache(maxsize=256)
def _gallery(source: str, config: str, setup: Setup) -> tuple[Array, ...]:
    """The local features of each stored picture of an object: those its model was learned from."""
    settings = Config.model_validate_json(config)
    pictures = setup.pictures(source, settings)
    try:
        directions = setup.model(source, settings).directions
        views = [pictures.render(CAMERA_DIRECTION, rotation_showing(d, CAMERA_DIRECTION)) for d in directions]
    finally:
        pictures.close()
    return tuple(local_features(image, mask) for image, mask in views)


def local_features(image: Array, mask: Array) -> Array:
    """(F, 128) float32 SIFT features of an image (H, W, 3) on the object."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    _, features = cv2.SIFT.create().detectAndCompute(grey, mask.astype(np.uint8))
    return np.empty((0, 128), np.float32) if features is None else features


def matches(features: Array, gallery: Sequence[Array]) -> Array:
    """(G,) how many features (F, 128) match each stored picture's (at least two each) by the ratio test."""
    stored = [picture for picture in gallery if len(picture) >= 2]
    if not stored:
        return np.zeros(0, int)
    together = np.concatenate(stored)
    squared = (together**2).sum(axis=1) - 2.0 * features @ together.T + (features**2).sum(axis=1)[:, None]
    ends = np.cumsum([len(picture) for picture in stored])[:-1]
    nearest = [np.partition(part, 1, axis=1)[:, :2] for part in np.split(squared, ends, axis=1)]
    return np.array([np.count_nonzero(best < RATIO**2 * second) for best, second in (two.T for two in nearest)])


BASELINES: dict[str, Scores] = {"nearest": _nearest, "vote": _vote, "sift": _sift}
