"""Objects for the simulated rig: mesh files, folders that hold one or a view set, and generated products."""

from __future__ import annotations

import tempfile
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from viewsep.sim.mesh import Mesh, check_mesh, find_mesh
from viewsep.sim.plate import Photos
from viewsep.sim.products import ProductSpec, parse_product, write_product
from viewsep.sim.render import CameraOptics, MeshRenderer, Pictures, Renderer
from viewsep.sim.render_cache import CachedRenderer, RenderCache
from viewsep.sim.view_set import is_view_set, read_view_set

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


def open_renderer(source: str, optics: CameraOptics, cache: RenderCache | None = None) -> Renderer:
    """A renderer of the checked mesh, which asks the cache first where one is given. Raises BadInput, BadMesh."""
    if cache is not None:
        return CachedRenderer(_mesh_of(source), optics, cache, lambda: open_renderer(source, optics))
    if not source.startswith(GENERATED):
        return MeshRenderer(_mesh_of(source), optics)
    with tempfile.TemporaryDirectory(prefix="viewsep-") as folder:  # the renderer has read it all when it returns
        return MeshRenderer(check_mesh(write_product(parse_product(source), Path(folder))), optics)


def open_pictures(source: str, optics: CameraOptics, cache: RenderCache | None = None) -> Pictures:
    """A mesh from everywhere, or an object's photos from where they were taken. Raises BadInput, BadMesh."""
    if is_view_set(Path(source)):
        view_set = read_view_set(Path(source))
        return Photos(view_set, range(len(view_set.images)), optics.size_px)
    return open_renderer(source, optics, cache)


def is_object(folder: Path) -> bool:
    """Whether a folder holds what can be learned: one mesh, or photos with their list. Raises BadInput for both."""
    return is_view_set(folder) or len(list(folder.glob("*.[oO][bB][jJ]"))) == 1


def _mesh_of(source: str) -> Mesh:
    """The checked mesh; that of a generated product is gone again. Raises BadInput, BadMesh."""
    return _product(parse_product(source)) if source.startswith(GENERATED) else _mesh_file(find_mesh(Path(source)))


@lru_cache(maxsize=256)
def _product(spec: ProductSpec) -> Mesh:
    with tempfile.TemporaryDirectory(prefix="viewsep-") as folder:
        return check_mesh(write_product(spec, Path(folder)))


_checked: dict[Path, tuple[list[tuple[int, int]], Mesh]] = {}


def _mesh_file(path: Path) -> Mesh:
    """The checked mesh; in one process it is read again only when one of its files has changed. Raises BadMesh."""
    before = _checked.get(path)
    if before is not None:
        with suppress(OSError):  # a file that is gone is named by the check
            if before[0] == _stamps(before[1]):
                return before[1]
    mesh = check_mesh(path)
    _checked[path] = _stamps(mesh), mesh
    return mesh


def _stamps(mesh: Mesh) -> list[tuple[int, int]]:
    """Size and time of change of the mesh's files. Raises OSError."""
    states = [path.stat() for path in (mesh.path, mesh.material, mesh.texture)]
    return [(state.st_size, state.st_mtime_ns) for state in states]
