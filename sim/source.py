"""Objects for the simulated rig: mesh files, folders that hold one or a view set, and generated products."""

from __future__ import annotations

import tempfile
from pathlib import Path

from viewsep.sim.mesh import check_mesh, find_mesh
from viewsep.sim.products import parse_product, write_product
from viewsep.sim.render import CameraOptics, MeshRenderer
from viewsep.sim.view_set import is_view_set

GENERATED = "generated:"


def object_name(source: str) -> str:
    """The object's name: a generated product's own, otherwise that of the mesh's or photos' folder. Raises BadInput."""
    if source.startswith(GENERATED):
        return parse_product(source).name
    if is_view_set(Path(source)):
        return Path(source).resolve().name
    return find_mesh(Path(source)).resolve().parent.name


def absolute_source(source: str) -> str:
    """The source as it can be found again from another folder."""
    return source if source.startswith(GENERATED) else str(Path(source).resolve())


def open_renderer(source: str, optics: CameraOptics) -> MeshRenderer:
    """A renderer of the checked mesh. Raises BadInput, BadMesh."""
    if not source.startswith(GENERATED):
        return MeshRenderer(check_mesh(find_mesh(Path(source))), optics)
    with tempfile.TemporaryDirectory(prefix="viewsep-") as folder:  # the renderer has read it all when it returns
        return MeshRenderer(check_mesh(write_product(parse_product(source), Path(folder))), optics)
