"""Learning models from rendered objects: views all around, Delaunay edges, one feature per view (section III.A)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import cv2
import joblib
import numpy as np

from viewsep import __version__
from viewsep.config import Config
from viewsep.errors import BadInput
from viewsep.geometry import delaunay_edges, equidistant_sphere, rotation_showing
from viewsep.models.aspect_graph import AspectGraph, Provenance
from viewsep.models.library import check_name
from viewsep.plugins import make_descriptor
from viewsep.sim.render import CameraOptics
from viewsep.sim.render_cache import RenderCache
from viewsep.sim.source import absolute_source, object_name, open_renderer

THUMBNAIL_PX = 48
CAMERA_DIRECTION = np.array([1.0, 0.0, 0.0])


def learn_object(source: str, name: str, views: int, config: Config, cache: RenderCache | None = None) -> AspectGraph:
    """The aspect graph of one object from `views` equidistant renders. Raises BadInput, BadMesh."""
    descriptor = make_descriptor(config.descriptor)
    directions = equidistant_sphere(views)
    renderer = open_renderer(source, CameraOptics(config.camera.size_px), cache)
    try:
        pictures = [
            renderer.render(CAMERA_DIRECTION, rotation_showing(direction, CAMERA_DIRECTION)) for direction in directions
        ]
    finally:
        renderer.close()
    size = (THUMBNAIL_PX, THUMBNAIL_PX)
    return AspectGraph(
        name=name,
        directions=directions,
        edges=delaunay_edges(directions),
        features=np.stack([descriptor.describe(image, mask) for image, mask in pictures]),
        thumbnails=np.stack([cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image, _ in pictures]),
        descriptor=descriptor.name,
        descriptor_parameters=descriptor.parameters,
        provenance=Provenance(absolute_source(source), renderer.mesh.digest, f"viewsep {__version__}"),
    )


def learn_objects(
    sources: Sequence[str], names: Sequence[str], views: int, config: Config, jobs: int = -1
) -> Iterator[AspectGraph]:
    """Learn many objects in parallel, yielding each when it is done. Raises BadInput before any work is done."""
    if not 12 <= views <= 2000:
        raise BadInput(f"--views {views}: use 12 to 2000 views per object (the seed's models have 100)")
    make_descriptor(config.descriptor)
    for name in names:
        if names.count(name) > 1:
            raise BadInput(
                f"two of the sources would be called {check_name(name)!r}: rename a folder, or learn one with --name"
            )
    tasks = [
        joblib.delayed(learn_object)(source, name, views, config) for source, name in zip(sources, names, strict=True)
    ]
    if len(tasks) == 1:
        jobs = 1
    yield from joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(tasks)


def names_for(sources: Sequence[str], name: str | None) -> list[str]:
    """The object's names: `name` for a single source, otherwise those of the sources. Raises BadInput."""
    if name is None:
        return [check_name(object_name(source)) for source in sources]
    if len(sources) != 1:
        raise BadInput(f"--name {name!r} goes with one source, but {len(sources)} were given: learn them one by one")
    return [check_name(name)]
