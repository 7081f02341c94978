"""A recording as a scene of pictures with known cameras: for NeRFs and splats, for COLMAP, and as BOP does it.

The object is the world: it stands still, and the camera goes around it. What is behind the object does not turn with
it, so all three come with masks.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from viewsep.errors import BadInput
from viewsep.geometry import matrix_to_quaternion
from viewsep.kinematics import RigGeometry
from viewsep.messages import FloatArray
from viewsep.recordings.camera_poses import ObjectPose, Optics, PosedPicture, posed_pictures
from viewsep.recordings.export import Exported, PictureFormat, Pictures, whole_folder
from viewsep.recordings.reader import Recording

OPENGL = np.diag([1.0, -1.0, -1.0])  # OpenCV's camera axes to OpenGL's: y up, z backwards
MM_PER_M = 1000.0


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """An object at a pose and pictures around it; `left_out` more have no joint angles around them."""

    pose: ObjectPose
    optics: Optics
    posed: tuple[PosedPicture, ...]
    left_out: int


def scene_of(recording: Recording, geometry: RigGeometry, pose: ObjectPose, optics: Optics) -> Scene:
    """The scene in a recording. Raises BadInput where it has no pictures."""
    posed = posed_pictures(recording, geometry, pose.rotation)
    if not posed:
        raise BadInput("the recording holds no pictures with joint angles around them; choose another recording")
    return Scene(pose, optics, tuple(posed), len(recording.frames) - len(posed))


def export_nerf(scene: Scene, out: Path, pictures: Pictures, force: bool) -> Exported:
    """Write `transforms.json`, `images/` and, beside JPEGs, `masks/`; PNGs have the mask in their alpha channel.

    `transform_matrix` is camera -> object (4, 4) with OpenGL's camera axes, lengths in the optics' unit. Raises
    BadInput.
    """
    posed, optics = scene.posed, scene.optics
    masked = pictures.format is PictureFormat.JPEG and all(p.frame.mask_png is not None for p in posed)
    alike = len({p.size_px for p in posed}) == 1
    frames: list[dict[str, Any]] = []
    with whole_folder(out, force) as folder:
        _make(folder, ["images", "masks"] if masked else ["images"])
        for number, picture in enumerate(posed):
            name = pictures.write(folder / "images", f"{number:06}", picture.frame, transparent=True)
            row: dict[str, Any] = {"file_path": f"images/{name}"}
            if masked:
                row["mask_path"] = f"masks/{number:06}.png"
                (folder / row["mask_path"]).write_bytes(picture.frame.mask_png or b"")
            row["transform_matrix"] = _camera_to_object(picture, optics).tolist()
            frames.append(row if alike else row | _nerf_intrinsics(picture, optics))
        shared = _nerf_intrinsics(posed[0], optics) if alike else {}
        _write_json(folder / "transforms.json", {"camera_model": "OPENCV"} | shared | {"frames": frames})
    return _exported(scene, optics.unit)


def export_colmap(scene: Scene, out: Path, pictures: Pictures, force: bool) -> Exported:
    """Write `images/`, `masks/` and the text model `sparse/0/` with cameras, images and no points.

    Poses are object -> camera, quaternion w x y z and translation, with OpenCV's camera axes, lengths in the optics'
    unit; the centre of the first pixel is at (0.5, 0.5). Raises BadInput.
    """
    posed, optics = scene.posed, scene.optics
    sizes = list(dict.fromkeys(p.size_px for p in posed))
    images = []
    with whole_folder(out, force) as folder:
        model = folder / "sparse" / "0"
        _make(folder, ["images", "masks", "sparse/0"])
        for number, picture in enumerate(posed):
            name = pictures.write(folder / "images", f"{number:06}", picture.frame)
            if picture.frame.mask_png is not None:
                (folder / "masks" / f"{name}.png").write_bytes(picture.frame.mask_png)
            x, y, z, w = matrix_to_quaternion(picture.rotation).tolist()
            pose = (number + 1, w, x, y, z, 0.0, 0.0, optics.distance, sizes.index(picture.size_px) + 1, name)
            images += [" ".join(map(str, pose)), ""]  # the second line would list points in the picture
        cameras = [_colmap_camera(number, size, optics) for number, size in enumerate(sizes, start=1)]
        _write_lines(model / "cameras.txt", "CAMERA_ID MODEL WIDTH HEIGHT fx fy cx cy", cameras)
        _write_lines(
            model / "images.txt", "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of points", images
        )
        _write_lines(model / "points3D.txt", "POINT3D_ID X Y Z R G B ERROR TRACK", [])
    return _exported(scene, optics.unit)


def export_bop(scene: Scene, out: Path, pictures: Pictures, force: bool) -> Exported:
    """Write one BOP scene: `rgb/`, `mask/`, `scene_camera.json` and `scene_gt.json`.

    Poses are object -> camera with OpenCV's camera axes, rotations row by row, translations in mm; the optics' unit
    must be metres. The centre of the first pixel is at (0, 0). Raises BadInput.
    """
    posed, optics = scene.posed, scene.optics
    if optics.unit != "m":
        raise BadInput(f"BOP needs lengths in mm, but the distance is known in {optics.unit} only; give it in metres")
    cameras, truth = {}, {}
    pose = {"cam_t_m2c": [0.0, 0.0, optics.distance * MM_PER_M], "obj_id": scene.pose.number}
    with whole_folder(out, force) as folder:
        _make(folder, ["rgb", "mask"])
        for number, picture in enumerate(posed):
            pictures.write(folder / "rgb", f"{number:06}", picture.frame)
            if picture.frame.mask_png is not None:
                (folder / "mask" / f"{number:06}_000000.png").write_bytes(picture.frame.mask_png)
            (width, height), f = picture.size_px, optics.focal_px(picture.size_px[0])
            k = [f, 0.0, (width - 1) / 2, 0.0, f, (height - 1) / 2, 0.0, 0.0, 1.0]
            cameras[str(number)] = {"cam_K": k, "depth_scale": 1.0}
            truth[str(number)] = [{"cam_R_m2c": picture.rotation.ravel().tolist()} | pose]
        _write_json(folder / "scene_camera.json", cameras)
        _write_json(folder / "scene_gt.json", truth)
    return _exported(scene, "mm", f"obj_id {scene.pose.number} is {scene.pose.name}")


def _exported(scene: Scene, unit: str, *notes: str) -> Exported:
    optics = scene.optics
    told = [
        f"seen from {scene.pose.name} in its pose at the end of the task",
        f"lengths are in {unit}; the camera's distance is {optics.distance:.4g} {optics.unit}, its field of view "
        f"{np.degrees(optics.fov_rad):g} deg",
        *notes,
    ]
    if scene.left_out:
        told.append(f"{scene.left_out} pictures without joint angles around them are left out")
    return Exported(len(scene.posed), tuple(told))


def _camera_to_object(picture: PosedPicture, optics: Optics) -> FloatArray:
    """(4, 4) camera -> object with OpenGL's camera axes."""
    matrix = np.eye(4)
    matrix[:3, :3] = picture.rotation.T @ OPENGL
    matrix[:3, 3] = optics.distance * picture.view_direction
    return matrix


def _nerf_intrinsics(picture: PosedPicture, optics: Optics) -> dict[str, Any]:
    width, height = picture.size_px
    f = optics.focal_px(width)
    size = {"w": width, "h": height, "fl_x": f, "fl_y": f, "cx": width / 2, "cy": height / 2}
    return {"camera_angle_x": optics.fov_rad} | size | dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0)


def _colmap_camera(number: int, size_px: tuple[int, int], optics: Optics) -> str:
    width, height = size_px
    f = optics.focal_px(width)
    return " ".join(map(str, (number, "PINHOLE", width, height, f, f, width / 2, height / 2)))


def _make(folder: Path, names: Iterable[str]) -> None:
    for name in names:
        (folder / name).mkdir(parents=True)


def _write_json(path: Path, value: Any) -> None:
    path.write_text(json.dumps(value, indent=1) + "\n", encoding="utf-8")


def _write_lines(path: Path, columns: str, lines: Iterable[str]) -> None:
    path.write_text("".join(f"{line}\n" for line in (f"# {columns}", *lines)), encoding="utf-8")
