"""Models that are painted instead of rendered: histograms that change smoothly over the sphere, and looks at them."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from viewsep.descriptors.cch import ColourCooccurrence
from viewsep.geometry import equidistant_sphere, random_rotation, view_edges
from viewsep.interpretation.filter_state import FilterOptions
from viewsep.interpretation.pose_filter import FilterInterpreter
from viewsep.interpretation.rotation_grid import rotation_grid
from viewsep.messages import Array, FloatArray, Percept
from viewsep.models.aspect_graph import AspectGraph, Provenance, Trials
from viewsep.trials import trial_directions

DIMENSIONS = 24
NODES = equidistant_sphere(100)
NODES.setflags(write=False)
EDGES = view_edges(NODES)
POLE = np.array([0.0, 0.0, 1.0])  # a twin differs within 60 degrees of it
TWIN = 20.0  # how much a twin differs there, unless said otherwise
TRIED = 60  # directions of trials, each with a clean look and a disturbed one


def painted(directions: FloatArray, paint: int, twin: float = 0.0) -> Array:
    """(N, D) histograms that change smoothly over the sphere; a twin differs around one pole only."""
    rng = np.random.default_rng(paint)
    centres = rng.normal(size=(DIMENSIONS, 3))
    centres /= np.linalg.norm(centres, axis=1, keepdims=True)
    shown = np.exp(3.0 * directions @ centres.T)
    if twin:
        shown[:, :4] *= 1.0 + twin * np.maximum(directions[:, 2:] - 0.5, 0.0)
    histograms: Array = (shown / shown.sum(axis=1, keepdims=True)).astype(np.float32)
    return histograms


def noisy(histograms: Array, noise: float, seed: int) -> Array:
    """(N, D) every value wrong by about the share `noise`, drawn anew for each."""
    rng = np.random.default_rng(seed)
    wrong = histograms * np.exp(noise * rng.normal(size=histograms.shape))
    worse: Array = (wrong / wrong.sum(axis=1, keepdims=True)).astype(np.float32)
    return worse


@cache
def model(
    name: str, paint: int, twin: float = 0.0, *, noise: float | None = None, disturbed: float = 0.0
) -> AspectGraph:
    """A model of 100 views, with trials between them where `noise` says how wrong the clean looks are."""
    trials = None if noise is None else trials_of_painted(paint, twin, noise, disturbed)
    return graph(name, NODES, EDGES, painted(NODES, paint, twin), trials)


def elsewhere(name: str, paint: int, twin: float = 0.0) -> AspectGraph:
    """A model whose views lie in other places."""
    at = NODES @ random_rotation(np.random.default_rng(5))
    return graph(name, at, EDGES, painted(at, paint, twin), trials_of_painted(paint, twin, 0.05, 0.05))


def trials_of_painted(paint: int, twin: float, noise: float, disturbed: float) -> Trials:
    at = trial_directions(TRIED)
    looks = painted(at, paint, twin)
    return Trials(
        np.concatenate([at, at]),
        np.concatenate([noisy(looks, noise, 100 + paint), noisy(looks, disturbed, 200 + paint)]),
        np.arange(2 * TRIED) >= TRIED,
    )


def ring(step_deg: float, elevation_deg: float = 0.0) -> FloatArray:
    """(N, 3) views around the axis z, the same angle above the equator."""
    azimuth, elevation = np.radians(np.arange(0, 360, step_deg)), np.radians(elevation_deg)
    flat = np.cos(elevation) * np.array([np.cos(azimuth), np.sin(azimuth)])
    return np.stack([*flat, np.full(len(azimuth), np.sin(elevation))], axis=1)


@cache
def ring_model(name: str, paint: int, elevation_deg: float = 0.0) -> AspectGraph:
    """24 views around the equator, or above it."""
    at = ring(15.0, elevation_deg)
    return graph(name, at, view_edges(at), painted(at, paint))


def graph(
    name: str, directions: FloatArray, edges: Array, features: Array, trials: Trials | None = None
) -> AspectGraph:
    return AspectGraph(
        name=name,
        directions=directions,
        edges=edges,
        features=features,
        thumbnails=np.zeros((len(directions), 4, 4, 3), np.uint8),
        descriptor="cch",
        descriptor_parameters={},
        provenance=Provenance("", "", ""),
        trials=trials,
    )


def unlearned(one: AspectGraph, around: FloatArray, within_deg: float, turn: FloatArray) -> AspectGraph:
    """The model without views within an angle of a direction, in a frame turned by `turn` (3, 3)."""

    def kept(directions: FloatArray) -> FloatArray:
        return np.asarray(directions @ around < np.cos(np.radians(within_deg)))

    views, trials = kept(one.directions), one.trials
    assert trials is not None
    tried = kept(trials.directions)
    return replace(
        one,
        directions=one.directions[views] @ turn.T,
        edges=(np.cumsum(views) - 1)[one.edges[views[one.edges].all(axis=1)]],
        features=one.features[views],
        thumbnails=one.thumbnails[views],
        trials=Trials(trials.directions[tried] @ turn.T, trials.features[tried], trials.disturbed[tried]),
    )


def interpreter(*models: AspectGraph, options: FilterOptions | None = None) -> FilterInterpreter:
    return FilterInterpreter(models, ColourCooccurrence(), options)


def unit(values: Array) -> FloatArray:
    return np.asarray(values / np.linalg.norm(values, axis=-1, keepdims=True))


def looks(seed: int, count: int, step_deg: float = 10.0) -> FloatArray:
    """(count, 3) views of a path that wanders over the sphere."""
    rng = np.random.default_rng(seed)
    view, ahead = np.linalg.qr(rng.normal(size=(3, 2)))[0].T
    path = [view]
    for _ in range(count - 1):
        ahead = unit(ahead + 0.3 * rng.normal(size=3))
        ahead = unit(ahead - (ahead @ view) * view)
        angle = np.radians(step_deg)
        view, ahead = np.cos(angle) * view + np.sin(angle) * ahead, np.cos(angle) * ahead - np.sin(angle) * view
        path.append(view)
    return np.array(path)


def held(seed: int) -> FloatArray:
    """A rotation in which the object is held, none of the filter's grid."""
    rotation: FloatArray = rotation_grid(7919)[seed * 101 % 7919]
    return rotation


def seen(
    views: FloatArray, rotation: FloatArray, paint: int, twin: float = 0.0, *, noise: float = 0.0, seed: int = 0
) -> list[Percept]:
    """What is seen of a painted object from (N, 3) views."""
    features = noisy(painted(views @ rotation, paint, twin), noise, seed)
    return [Percept(n, n, "cch", feature, view) for n, (feature, view) in enumerate(zip(features, views, strict=True))]
