"""Draws the pictures of docs/method.md: `python docs/method/draw.py`. All of it is measured on generated boxes."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection

from viewsep.bench.turned import TurnedObject
from viewsep.config import Config, parse_config
from viewsep.geometry import azimuth_elevation, equidistant_sphere, great_circle, random_rotation
from viewsep.interpretation.pose_filter import FilterInterpreter
from viewsep.interpretation.predictions import predictions_of
from viewsep.interpretation.view_cells import cell_directions
from viewsep.learning import learn_object
from viewsep.planning.promise import promised
from viewsep.plugins import make_descriptor
from viewsep.sim.render import CameraOptics
from viewsep.sim.source import open_renderer

FOLDER = Path(__file__).parent
BOX, TWIN = "generated:7", "generated:7:twin=face"
CONFIG: Config = parse_config(
    {"descriptor": {"name": "opponent+rings"}, "interpreter": {"name": "filter"}, "planner": {"name": "information"}},
    "docs/method/draw.py",
)
COLOURS = ("#1f77b4", "#d95f02", "#7a7a7a")


def main() -> None:
    """Learn two look-alike boxes, turn one of them along an arc, draw what the filter makes of it."""
    models = tuple(learn_object(source, name, 100, CONFIG) for source, name in ((BOX, "box"), (TWIN, "twin")))
    descriptor = make_descriptor(CONFIG.descriptor)
    machine = FilterInterpreter(models, descriptor)
    renderer = open_renderer(BOX, CameraOptics(CONFIG.camera.size_px), None)
    held = TurnedObject(renderer, random_rotation(np.random.default_rng(4)), CONFIG, seed=4)
    start, end = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.8, 0.6])
    state, course, kept = machine.start(), [], {}
    for index, view in enumerate([start, *great_circle(start, end, np.radians(10.0))]):
        state, belief = machine.update(state, held.percept(index, view))
        course.append([*(candidate.probability for candidate in belief.estimate.candidates), belief.estimate.unknown])
        kept[index + 1] = (state, belief, view)
    _posterior(machine, kept, held.rotation)
    _information(models, kept)
    _likelihood(models)
    renderer.close()


def _posterior(machine: FilterInterpreter, kept: dict, truth: np.ndarray) -> None:
    """Where every rotation of the first box believes the last view to be, by its probability."""
    figure, axes = plt.subplots(1, 3, figsize=(12, 3.4), layout="constrained")
    for ax, looks in zip(axes, (1, 3, 6), strict=True):
        state, belief, view = kept[looks]
        seen = view @ machine.grid.rotations
        share = state.posterior.log_p[0] / np.log(10.0)
        order = np.argsort(share)
        shown = _sphere(ax, seen[order], np.maximum(share[order], -8.0), size=7)
        azimuth, elevation = np.degrees(azimuth_elevation(view @ truth))
        ax.plot(azimuth, elevation, "+", color="#d62728", markersize=14, markeredgewidth=2)
        said = ", ".join(f"{c.name} {c.probability:.2f}" for c in belief.estimate.candidates)
        ax.set_title(f"{looks} look{'s' * (looks > 1)}: {said}", fontsize=10)
    figure.colorbar(shown, ax=axes, label="log10 of a rotation's probability")
    figure.savefig(FOLDER / "posterior.png", dpi=90)


def _information(models: tuple, kept: dict) -> None:
    """Bits about the candidate that a look from every view promises, after a few looks."""
    predictions, views = predictions_of(models), equidistant_sphere(800)
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    for ax, looks in zip(axes, (1, 4), strict=True):
        _, belief, view = kept[looks]
        bits = promised(predictions, belief.samples, views).candidate
        shown = _sphere(ax, views, bits, size=26)
        azimuth, elevation = np.degrees(azimuth_elevation(view))
        ax.plot(azimuth, elevation, "+", color="#d62728", markersize=14, markeredgewidth=2)
        ax.set_title(f"after {looks} look{'s' * (looks > 1)}", fontsize=10)
        figure.colorbar(shown, ax=ax, label="bits about the candidate")
    figure.savefig(FOLDER / "information.png", dpi=110)


def _likelihood(models: tuple) -> None:
    """Distances of the trials from what the model predicts, with the laws learned from them, and of other views."""
    predictions = predictions_of(models)
    figure, ax = plt.subplots(figsize=(7, 3.6), layout="constrained")
    m = predictions.dimensions
    trials = models[0].trials
    for kind, (law, name) in enumerate(zip(predictions.laws, ("clean looks", "disturbed looks"), strict=True)):
        chosen = np.flatnonzero(trials.disturbed == bool(kind))[1::2]
        distance2 = []
        for r in chosen:
            look = predictions.project(trials.features[r])
            near = predictions.distance2(look, np.array([0]))[0]
            distance2.append(near[np.argmax(cell_directions() @ trials.directions[r])])
        ax.hist(np.sqrt(distance2), bins=15, density=True, alpha=0.45, color=COLOURS[kind], label=name)
        radius = np.linspace(0.1, 80, 800)
        density = np.exp(law.log(radius**2).astype(float)) * radius ** (m - 1)
        ax.plot(radius, density / np.trapezoid(density, radius), color=COLOURS[kind], label=f"law of {name}")
    other = [np.sqrt(predictions.distance2(look, np.array([1]))[0].mean()) for look in predictions.views[:100]]
    ax.hist(other, bins=15, density=True, alpha=0.35, color=COLOURS[2], label="any other view")
    ax.set(xlabel="distance from what the model predicts, in the learned metric", ylabel="density", xlim=(0, 80))
    ax.legend(fontsize=8)
    figure.savefig(FOLDER / "likelihood.png", dpi=110)


def _sphere(ax: Axes, directions: np.ndarray, weight: np.ndarray, size: float) -> PathCollection:
    """Directions (N, 3) in azimuth and elevation, darker where the weight is larger."""
    azimuth, elevation = np.degrees(np.array([azimuth_elevation(direction) for direction in directions])).T
    ax.set(xlim=(-180, 180), ylim=(-90, 90), xlabel="azimuth, degrees", ylabel="elevation, degrees")
    ax.set_xticks([-180, -90, 0, 90, 180])
    return ax.scatter(azimuth, elevation, c=weight, s=size, cmap="Blues", linewidths=0)


if __name__ == "__main__":
    main()
