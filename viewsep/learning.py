"""Learning models from rendered objects or from photos: views, who neighbours whom, a feature each (section III.A)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import joblib
import numpy as np

from viewsep import __version__
from viewsep.config import Config
from viewsep.errors import BadInput
from viewsep.geometry import equidistant_sphere, rotation_showing, view_edges
from viewsep.messages import Array, FloatArray
from viewsep.models.aspect_graph import AspectGraph, Provenance, Trials
from viewsep.models.library import check_name
from viewsep.plugins import make_descriptor
from viewsep.sim.render import CameraOptics
from viewsep.sim.render_cache import RenderCache
from viewsep.sim.source import absolute_source, object_name, open_renderer
from viewsep.sim.view_choice import every_kth, named_views
from viewsep.sim.view_set import is_view_set, read_view_set
from viewsep.trials import rolls, trial_directions, trials_of

THUMBNAIL_PX = 48
MESH_VIEWS = 100  # the seed's
TRIALS_PER_VIEW, FEWEST_TRIALS = 0.6, 24  # an even number: both looks of a trial then fall in the same half of them
FEWEST_NODES = 3  # of a model from photos
CAMERA_DIRECTION = np.array([1.0, 0.0, 0.0])


def learn_object(
    source: str,
    name: str,
    views: int,
    config: Config,
    cache: RenderCache | None = None,
    turned: FloatArray | None = None,
) -> AspectGraph:
    """The aspect graph of a mesh or generated product from `views` equidistant renders. Raises BadInput, BadMesh.

    They are in the same places for every object, or `turned` (3, 3) from there.
    """
    directions = equidistant_sphere(views)
    if turned is not None:
        directions = directions @ turned
    tried = trial_directions(max(FEWEST_TRIALS, 2 * round(0.5 * TRIALS_PER_VIEW * views)))
    renderer = open_renderer(source, CameraOptics(config.camera.size_px), cache)
    try:
        pictures = [
            renderer.render(CAMERA_DIRECTION, rotation_showing(direction, CAMERA_DIRECTION)) for direction in directions
        ]
        between = [
            renderer.render(CAMERA_DIRECTION, rotation_showing(direction, CAMERA_DIRECTION, roll))
            for direction, roll in zip(tried, rolls(len(tried)), strict=True)
        ]
    finally:
        renderer.close()
    provenance = Provenance(absolute_source(source), renderer.mesh.digest, f"viewsep {__version__}")
    trials = trials_of(tried, between, make_descriptor(config.descriptor))
    return _model(name, directions, pictures, config, provenance, trials)


def learn_view_set(
    folder: Path, name: str, config: Config, *, every: int | None = None, nodes: Path | None = None
) -> AspectGraph:
    """The aspect graph of an object from photos: every `every`-th of them, those named in the file `nodes`, or all.

    Photos that the list calls trials are trials between the views. Raises BadInput, also when the chosen views are too
    few or too scattered for any two to be neighbours.
    """
    view_set = read_view_set(folder)
    chosen = named_views(view_set, nodes) if nodes else every_kth(view_set, 1 if every is None else every)
    if len(chosen) < FEWEST_NODES:
        raise BadInput(
            f"{folder}: {len(chosen)} of {len(view_set.images)} photos as nodes are too few (at least {FEWEST_NODES}); "
            "choose more of them with a smaller --every or a longer list of --nodes, or take more"
        )
    pictures = [view_set.picture(index, config.camera.size_px) for index in chosen]
    provenance = Provenance(str(view_set.folder), view_set.digest, f"viewsep {__version__}")
    directions = view_set.directions[chosen]
    trials = trials_of(directions, pictures, make_descriptor(config.descriptor), between=False)
    tried = [int(index) for index in np.flatnonzero(view_set.trial) if index not in chosen]
    tried = tried[: len(tried) // 2 * 2]  # an even number, as of renders
    if tried:
        between = [view_set.picture(index, config.camera.size_px) for index in tried]
        real = trials_of(view_set.directions[tried], between, make_descriptor(config.descriptor))
        trials = real.joined(trials)
    model = _model(name, directions, pictures, config, provenance, trials)
    if len(model.edges) == 0:
        raise BadInput(
            f"{folder}: no two of the {len(chosen)} chosen views are neighbours, so far apart do they lie; choose "
            "more views"
        )
    return model


def _model(
    name: str,
    directions: FloatArray,
    pictures: Sequence[tuple[Array, Array]],
    config: Config,
    provenance: Provenance,
    trials: Trials,
) -> AspectGraph:
    """The aspect graph of pictures with masks that show an object from directions (N, 3)."""
    descriptor = make_descriptor(config.descriptor)
    size = (THUMBNAIL_PX, THUMBNAIL_PX)
    return AspectGraph(
        name=name,
        directions=directions,
        edges=view_edges(directions),
        features=np.stack([descriptor.describe(image, mask) for image, mask in pictures]),
        thumbnails=np.stack([cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image, _ in pictures]),
        descriptor=descriptor.name,
        descriptor_parameters=descriptor.parameters,
        provenance=provenance,
        trials=trials,
    )


def learn_objects(
    sources: Sequence[str],
    names: Sequence[str],
    views: int | None,
    config: Config,
    jobs: int = -1,
    *,
    every: int | None = None,
    nodes: Path | None = None,
) -> Iterator[AspectGraph]:
    """Learn many objects in parallel, yielding each when it is done. Raises BadInput before any work is done.

    `views` is how many renders of meshes become nodes (None: the seed's 100), `every` and `nodes` choose photos.
    """
    if views is not None and not 12 <= views <= 2000:
        raise BadInput(f"--views {views}: use 12 to 2000 views per object (the seed's models have {MESH_VIEWS})")
    make_descriptor(config.descriptor)
    for name in names:
        if names.count(name) > 1:
            raise BadInput(
                f"two of the sources would be called {check_name(name)!r}: rename a folder, or learn one with --name"
            )
    tasks = []
    for source, name in zip(sources, names, strict=True):
        photos = is_view_set(Path(source))
        _check_choice(source, photos, views, every, nodes)
        if photos:
            tasks.append(joblib.delayed(learn_view_set)(Path(source), name, config, every=every, nodes=nodes))
        else:
            tasks.append(joblib.delayed(learn_object)(source, name, views or MESH_VIEWS, config))
    if len(tasks) == 1:
        jobs = 1
    yield from joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(tasks)


def _check_choice(source: str, photos: bool, views: int | None, every: int | None, nodes: Path | None) -> None:
    """Photos are chosen by `every` or `nodes`, renders by `views`. Raises BadInput."""
    if every is not None and nodes is not None:
        raise BadInput("--every and --nodes exclude each other, both say which photos become nodes: give one")
    if photos and views is not None:
        raise BadInput(f"--views {views} goes with meshes, but {source} holds photos: use --every K or --nodes FILE")
    given = f"--every {every}" if every is not None else f"--nodes {nodes}" if nodes is not None else ""
    if given and not photos:
        raise BadInput(f"{given} goes with photos, but {source} has no views.csv: use --views N for renders of a mesh")


def names_for(sources: Sequence[str], name: str | None) -> list[str]:
    """The object's names: `name` for a single source, otherwise those of the sources. Raises BadInput."""
    if name is None:
        return [check_name(object_name(source)) for source in sources]
    if len(sources) != 1:
        raise BadInput(f"--name {name!r} goes with one source, but {len(sources)} were given: learn them one by one")
    return [check_name(name)]
