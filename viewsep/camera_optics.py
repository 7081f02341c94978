"""What is known of the camera that took a recording's pictures."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from viewsep.config import Config
from viewsep.errors import BadInput
from viewsep.framing import FRAME_FILL
from viewsep.models.aspect_graph import AspectGraph
from viewsep.recordings.camera_poses import Optics
from viewsep.sim.mesh import Mesh, check_mesh, find_mesh
from viewsep.sim.products import parse_product, write_product
from viewsep.sim.render import FIELD_OF_VIEW_DEG
from viewsep.sim.source import GENERATED

RADII = "radii of the object"


def recorded_optics(config: Config) -> Optics | None:
    """The simulated camera's, lengths in radii of the object's bounding sphere; None where photos were shown."""
    if config.rig.backend == "photos":
        return None
    fov_rad = float(np.radians(FIELD_OF_VIEW_DEG))
    return Optics(fov_rad, float(1.0 / (FRAME_FILL * np.sin(fov_rad / 2))), RADII)


def in_metres(optics: Optics, model: AspectGraph) -> Optics | None:
    """Optics in radii of what `model` was learned from, in metres; None where its mesh is gone or has changed."""
    try:
        mesh = _mesh(model.provenance.source)
    except BadInput:
        return None
    if mesh.digest != model.provenance.source_digest:
        return None
    return Optics(optics.fov_rad, optics.distance * mesh.radius_m, "m")


def _mesh(source: str) -> Mesh:
    """The mesh of a source. Raises BadInput."""
    if not source.startswith(GENERATED):
        return check_mesh(find_mesh(Path(source)))
    with tempfile.TemporaryDirectory(prefix="viewsep-") as folder:
        return check_mesh(write_product(parse_product(source), Path(folder)))
