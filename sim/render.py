"""Pictures of a mesh by pybullet's tiny renderer: deterministic, without a display or a GPU."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import cv2
import numpy as np

from viewsep.framing import FRAME_FILL
from viewsep.geometry import matrix_to_quaternion, perpendicular
from viewsep.messages import Array, FloatArray
from viewsep.sim.mesh import Mesh, check_mesh
from viewsep.sim.physics import load_pybullet

FIELD_OF_VIEW_DEG = 20.0
LOOKS = 1  # to be raised with every change of what pictures look like: caches tell old and new ones apart by it
SUPERSAMPLING = 2  # the renderer does not smooth: render larger, average down


@dataclass(frozen=True, slots=True)
class CameraOptics:
    """Picture size in pixels (square)."""

    size_px: int = 128


class Pictures(Protocol):
    """How an object looks: rendered from a mesh, or photos of it."""

    def render(self, camera_direction: FloatArray, rotation: FloatArray) -> tuple[Array, Array]:
        """Picture (H, W, 3) uint8 RGB and mask (H, W) bool.

        `camera_direction` is the (3,) direction from the object to the camera and `rotation` (3, 3) turns the object,
        both in the world's frame.
        """
        ...

    def close(self) -> None:
        """Leave whatever was opened. Safe to call twice."""
        ...


class Renderer(Pictures, Protocol):
    """Pictures of one mesh. The same pose gives the same picture, bit for bit, whatever was rendered before."""

    mesh: Mesh


class MeshRenderer:
    """`Renderer` with one mesh in one pybullet world, centred and scaled so that its bounding sphere fills the picture.

    The object turns, the camera and the light (on the line of sight) stay: what counts is the rotation of the object
    in the camera's frame. Rendering is bit-reproducible for a rotation, whatever was rendered before.
    """

    def __init__(self, mesh: Mesh | Path, optics: CameraOptics | None = None) -> None:
        self.mesh = check_mesh(mesh) if isinstance(mesh, Path) else mesh
        self.optics = optics or CameraOptics()
        self._bullet = pybullet = load_pybullet()
        self._client = pybullet.connect(pybullet.DIRECT)
        scale = 1.0 / self.mesh.radius_m
        shape = pybullet.createVisualShape(
            pybullet.GEOM_MESH,
            fileName=str(self.mesh.path),
            meshScale=[scale] * 3,
            visualFramePosition=[-scale * c for c in self.mesh.centre_m],
            rgbaColor=[1, 1, 1, 1],
            specularColor=[0, 0, 0],
            physicsClientId=self._client,
        )
        self._body = pybullet.createMultiBody(0, baseVisualShapeIndex=shape, physicsClientId=self._client)

    def render(self, camera_direction: FloatArray, rotation: FloatArray) -> tuple[Array, Array]:
        """Picture (H, W, 3) uint8 RGB on white and mask (H, W) bool, on white, as `Pictures` says."""
        pybullet = self._bullet
        x, y, z, w = matrix_to_quaternion(rotation)
        pybullet.resetBasePositionAndOrientation(self._body, [0, 0, 0], [x, y, z, w], physicsClientId=self._client)
        distance = 1.0 / (FRAME_FILL * np.sin(np.radians(FIELD_OF_VIEW_DEG) / 2))
        eye = (camera_direction * distance).tolist()
        up = np.array([0.0, 0.0, 1.0])
        if abs(camera_direction[2]) > 0.99:
            up = perpendicular(camera_direction)
        size = self.optics.size_px * SUPERSAMPLING
        _, _, rgba, _, segmentation = pybullet.getCameraImage(
            size,
            size,
            viewMatrix=pybullet.computeViewMatrix(eye, [0, 0, 0], up.tolist()),
            projectionMatrix=pybullet.computeProjectionMatrixFOV(
                FIELD_OF_VIEW_DEG, 1.0, distance - 1.5, distance + 1.5
            ),
            lightDirection=camera_direction.tolist(),
            lightColor=[1, 1, 1],
            lightAmbientCoeff=0.55,
            lightDiffuseCoeff=0.45,
            lightSpecularCoeff=0.0,
            shadow=0,
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
        )
        fine = np.asarray(rgba, np.uint8).reshape(size, size, 4)[..., :3]
        on_object = (np.asarray(segmentation).reshape(size, size) == self._body).astype(np.float32)
        target = (self.optics.size_px, self.optics.size_px)
        image = cv2.resize(fine, target, interpolation=cv2.INTER_AREA)
        mask = cv2.resize(on_object, target, interpolation=cv2.INTER_AREA) >= 0.5
        return image, mask

    def close(self) -> None:
        """Leave the world. Safe to call twice."""
        if self._client >= 0:
            self._bullet.disconnect(self._client)
            self._client = -1
