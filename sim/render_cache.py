"""Rendered pictures kept on disk by what they depend on, so that an experiment renders none of them twice.

Files are written under a temporary name and renamed, so any number of processes may read and write one folder.
"""

from __future__ import annotations

import hashlib
import os
import zlib
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from tempfile import NamedTemporaryFile

import cv2
import numpy as np
import platformdirs
import scipy

from viewsep.errors import BadInput, BadMesh
from viewsep.messages import Array, FloatArray
from viewsep.sim.mesh import Mesh
from viewsep.sim.render import LOOKS, CameraOptics, Renderer

LIMIT_BYTES = 2 * 10**9
SHELVES = 256  # sub-folders: each keeps its own share of the limit, so that nobody ever lists the whole cache
CHECKSUM_BYTES = 4

Picture = tuple[Array, Array]
"""(H, W, 3) uint8 RGB and (H, W) bool mask."""


def picture_key(mesh_digest: str, optics: CameraOptics, camera_direction: FloatArray, rotation: FloatArray) -> str:
    """The sha256 (hex) over everything a picture depends on: mesh with texture, renderer, optics, the exact pose."""
    pose = np.concatenate([camera_direction, rotation.ravel()]).astype(np.float64).tobytes()
    return hashlib.sha256(f"{mesh_digest}\n{_renderer_version()}\n{optics}\n".encode() + pose).hexdigest()


@cache
def _renderer_version() -> str:
    """Everything whose change may change pictures."""
    return f"looks {LOOKS}, pybullet {version('pybullet')}, opencv {cv2.__version__}, scipy {scipy.__version__}"


class RenderCache:
    """A folder of pictures of at most about `limit_bytes`; by default the cache folder of whoever runs the process.

    Where it gets too large the least recently used go first. A picture is a PNG with the mask as alpha and a checksum
    after its end.
    """

    def __init__(self, folder: Path | None = None, limit_bytes: int = LIMIT_BYTES) -> None:
        self._folder = folder
        self.limit_bytes = limit_bytes

    @property
    def folder(self) -> Path:
        """Where the pictures are; told here, not once for all, as a cache may be sent to another machine."""
        return self._folder or platformdirs.user_cache_path("viewsep") / "renders"

    def get(self, key: str) -> Picture | None:
        """The picture, None where it is not there or damaged. Raises BadInput when the folder cannot be used."""
        path = self._path(key)
        try:
            data = path.read_bytes()
            os.utime(path)
        except FileNotFoundError:
            return None
        except OSError as error:
            raise self._unusable(error) from error
        return _decoded(data)

    def put(self, key: str, picture: Picture) -> None:
        """Keep a picture, instead of a damaged one too. Raises BadInput when the folder cannot be used."""
        path, data = self._path(key), _encoded(picture)
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with NamedTemporaryFile(dir=path.parent, delete=False) as file:
                partial = Path(file.name)
                file.write(data)
            partial.replace(path)
            self._make_room(path)
        except FileNotFoundError:  # somebody clears the folder: the picture is not kept, that is all
            return
        except OSError as error:
            raise self._unusable(error) from error

    def _path(self, key: str) -> Path:
        return self.folder / f"{int(key[:8], 16) % SHELVES:02x}" / f"{key}.png"

    def _make_room(self, newest: Path) -> None:
        """Bring a shelf back under its share, whatever other processes do to it meanwhile; `newest` stays."""
        files = []
        for path in newest.parent.iterdir():
            with suppress(FileNotFoundError):
                state = path.stat()
                files.append((path == newest, state.st_mtime_ns, state.st_size, path))
        excess = sum(size for _, _, size, _ in files) - self.limit_bytes // SHELVES
        for is_newest, _, size, path in sorted(files):
            if excess <= 0 or is_newest:
                break
            path.unlink(missing_ok=True)
            excess -= size

    def _unusable(self, error: OSError) -> BadInput:
        return BadInput(
            f"cannot use the render cache {self.folder}: {error.strerror}; choose another folder or do without a cache"
        )


class CachedRenderer:
    """A `Renderer` that looks into the cache first and calls `open_renderer` only when a picture is not there."""

    def __init__(
        self, mesh: Mesh, optics: CameraOptics, cache: RenderCache, open_renderer: Callable[[], Renderer]
    ) -> None:
        self.mesh = mesh
        self._optics = optics
        self._cache = cache
        self._open_renderer = open_renderer
        self._renderer: Renderer | None = None

    def render(self, camera_direction: FloatArray, rotation: FloatArray) -> Picture:
        """The same picture and mask, bit for bit, as the renderer's. Raises BadInput when the cache cannot be used."""
        key = picture_key(self.mesh.digest, self._optics, camera_direction, rotation)
        picture = self._cache.get(key)
        if picture is None:
            picture = self._opened().render(camera_direction, rotation)
            self._cache.put(key, picture)
        return picture

    def close(self) -> None:
        """Close the renderer where one was needed. Safe to call twice."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _opened(self) -> Renderer:
        if self._renderer is None:
            self._renderer = self._open_renderer()
            if self._renderer.mesh.digest != self.mesh.digest:
                raise BadMesh(f"{self.mesh.path}: was changed while pictures of it were taken; start again")
        return self._renderer


def _encoded(picture: Picture) -> bytes:
    image, mask = picture
    pixels = np.dstack([image[..., ::-1], np.where(mask, np.uint8(255), np.uint8(0))])
    data = cv2.imencode(".png", pixels)[1].tobytes()
    return data + zlib.crc32(data).to_bytes(CHECKSUM_BYTES, "big")


def _decoded(data: bytes) -> Picture | None:
    """The picture in a file, None where the file is damaged."""
    png, checksum = data[:-CHECKSUM_BYTES], data[-CHECKSUM_BYTES:]
    if not png or zlib.crc32(png).to_bytes(CHECKSUM_BYTES, "big") != checksum:
        return None
    pixels: Array | None = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        return None
    return np.ascontiguousarray(pixels[..., 2::-1]), pixels[..., 3] > 0
