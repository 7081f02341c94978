"""The cameras that an export tells of, read back from its files, and what the golden recording's truly saw."""

from __future__ import annotations

import json
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from golden_recording import TRUTH, golden
from scipy.spatial.transform import Rotation

from viewsep.camera_optics import recorded_optics
from viewsep.config import Config, geometry_of
from viewsep.geometry import random_rotation
from viewsep.messages import FloatArray
from viewsep.models.aspect_graph import AspectGraph
from viewsep.recordings.camera_poses import ObjectPose, Optics
from viewsep.recordings.export_scenes import Scene, scene_of
from viewsep.recordings.replay import restore
from viewsep.sim.mesh import Mesh, check_mesh
from viewsep.sim.products import parse_product, write_product

SIZE = 80


class Camera(NamedTuple):
    """A camera of an export: object -> camera with OpenCV's axes, and pixels with the first one's centre at 0.5."""

    rotation: FloatArray
    translation: FloatArray
    matrix: FloatArray

    @property
    def centre(self) -> FloatArray:
        centre: FloatArray = -self.rotation.T @ self.translation
        return centre

    @property
    def axis(self) -> FloatArray:
        axis: FloatArray = self.rotation[2]
        return axis

    def project(self, points: FloatArray) -> FloatArray:
        """(N, 3) points of the object -> (N, 2) pixels."""
        seen = points @ self.rotation.T + self.translation
        pixels: FloatArray = (seen / seen[:, 2:] @ self.matrix.T)[:, :2]
        return pixels


def nerf_cameras(folder: Path) -> list[Camera]:
    said = json.loads((folder / "transforms.json").read_text())
    cameras = []
    for frame in said["frames"]:
        to_object = np.array(frame["transform_matrix"])
        assert (to_object[3] == [0, 0, 0, 1]).all()
        to_camera = np.diag([1.0, -1.0, -1.0]) @ to_object[:3, :3].T  # from OpenGL's axes
        k = said | frame
        matrix = np.array([[k["fl_x"], 0, k["cx"]], [0, k["fl_y"], k["cy"]], [0, 0, 1]])
        cameras.append(Camera(to_camera, -to_camera @ to_object[:3, 3], matrix))
    return cameras


def colmap_cameras(folder: Path) -> list[Camera]:
    def lines(name: str) -> list[list[str]]:
        text = (folder / "sparse" / "0" / name).read_text().splitlines()
        return [line.split() for line in text if not line.startswith("#")]

    matrices = {}
    for camera_id, model, _, _, fx, fy, cx, cy in lines("cameras.txt"):
        assert model == "PINHOLE"
        matrices[camera_id] = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], float)
    cameras = []
    images = lines("images.txt")
    assert images[1::2] == [[]] * (len(images) // 2)  # no points in the pictures
    for number, (image_id, *pose, camera_id, name) in enumerate(images[::2]):
        assert (image_id, name) == (str(number + 1), f"{number:06}.jpg")
        w, x, y, z, *translation = map(float, pose)
        rotation = Rotation.from_quat([x, y, z, w]).as_matrix()
        cameras.append(Camera(rotation, np.array(translation), matrices[camera_id]))
    assert lines("points3D.txt") == []
    return cameras


def bop_cameras(folder: Path, radius_mm: float) -> list[Camera]:
    known = json.loads((folder / "scene_camera.json").read_text())
    truth = json.loads((folder / "scene_gt.json").read_text())
    cameras = []
    for number in range(len(truth)):
        (seen,) = truth[str(number)]
        rotation = np.array(seen["cam_R_m2c"]).reshape(3, 3)
        matrix = np.array(known[str(number)]["cam_K"]).reshape(3, 3)
        matrix[:2, 2] += 0.5  # there the first pixel's centre is at 0
        cameras.append(Camera(rotation, np.array(seen["cam_t_m2c"]) / radius_mm, matrix))
    return cameras


def simulated_optics() -> Optics:
    """The simulated camera's."""
    optics = recorded_optics(Config())
    assert optics is not None
    return optics


@lru_cache(maxsize=1)
def restored() -> tuple[Config, list[AspectGraph]]:
    """Configuration and models of the golden recording."""
    return restore(golden())


@lru_cache(maxsize=1)
def true_scene() -> Scene:
    """The golden recording's pictures around the object as it truly stood in the holder."""
    true_rotation = random_rotation(np.random.default_rng([1, 1]))  # as the simulation draws it from the seed 1
    return scene_of(golden(), geometry_of(restored()[0].rig), ObjectPose(TRUTH, 2, true_rotation), simulated_optics())


@lru_cache(maxsize=1)
def box() -> tuple[FloatArray, Mesh]:
    """The vertices (V, 3) of the box in the holder, centred, in radii, and its mesh."""
    with tempfile.TemporaryDirectory() as folder:
        path = write_product(parse_product("generated:7:twin=face"), Path(folder))
        mesh = check_mesh(path)
        vertices = [line.split()[1:4] for line in path.read_text().splitlines() if line.startswith("v ")]
    return (np.array(vertices, float) - mesh.centre_m) / mesh.radius_m, mesh
