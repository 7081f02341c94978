"""Objects for the simulated rig: mesh files, folders that hold one, and generated products."""

from __future__ import annotations

import tempfile
from contextlib import suppress
from pathlib import Path

from viewsep.sim.mesh import Mesh, check_mesh, find_mesh
from viewsep.sim.products import parse_product, write_product
from viewsep.sim.render import CameraOptics, MeshRenderer

GENERATED = "generated:"


def object_name(source: str) -> str:
    """The object's name: a generated product's own, otherwise that of the folder the mesh is in. Raises BadInput."""
    if source.startswith(GENERATED):
        return parse_product(source).name
    return find_mesh(Path(source)).resolve().parent.name


def absolute_source(source: str) -> str:
    """The source as it can be found again from another folder."""
    return source if source.startswith(GENERATED) else str(Path(source).resolve())


def open_renderer(source: str, optics: CameraOptics) -> MeshRenderer:
    """A renderer of the checked mesh. Raises BadInput, BadMesh."""
    if not source.startswith(GENERATED):
        return MeshRenderer(_mesh_file(find_mesh(Path(source))), optics)
    with tempfile.TemporaryDirectory(prefix="viewsep-") as folder:  # the renderer has read it all when it returns
        return MeshRenderer(check_mesh(write_product(parse_product(source), Path(folder))), optics)


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
