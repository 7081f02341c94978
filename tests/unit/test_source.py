"""Objects for the simulated rig: what was checked once is not checked again, unless a file has changed."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from viewsep.errors import BadMesh
from viewsep.sim.render import CameraOptics
from viewsep.sim.source import open_renderer

pytestmark = pytest.mark.needs_pybullet


@pytest.fixture
def folder(product_mesh: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(product_mesh.parent, tmp_path / "product"))


def digest_of(source: Path) -> str:
    renderer = open_renderer(str(source), CameraOptics())
    renderer.close()
    return renderer.mesh.digest


def test_a_change_of_any_file_of_the_mesh_is_noticed(folder: Path) -> None:
    seen = {digest_of(folder), digest_of(folder)}
    assert len(seen) == 1
    for path in sorted(folder.iterdir()):
        path.write_bytes(path.read_bytes() + b"\n")
        seen.add(digest_of(folder))
    assert len(seen) == 4


def test_a_texture_that_is_gone_is_noticed(folder: Path) -> None:
    digest_of(folder)
    (texture,) = folder.glob("*.png")
    texture.unlink()
    with pytest.raises(BadMesh, match="names a texture that is missing"):
        digest_of(folder)
