"""A recording as a view set (photos with `views.csv`), to learn a model from what the camera saw."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import numpy as np

from viewsep.errors import BadInput
from viewsep.geometry import angle_between, azimuth_elevation
from viewsep.messages import FloatArray
from viewsep.recordings.camera_poses import ObjectPose, used_percepts
from viewsep.recordings.codec import RecordedFrame
from viewsep.recordings.export import Exported, Pictures, whole_folder
from viewsep.recordings.reader import Recording

COLUMNS = ("image", "azimuth_deg", "elevation_deg", "mask")
SAME_VIEW_RAD = 2e-3  # a view set refuses views closer than half of that
FEWEST_VIEWS = 3  # that a model is learned from


def export_views(recording: Recording, pose: ObjectPose, out: Path, pictures: Pictures, force: bool) -> Exported:
    """Write the folder `out`: pictures whose percepts were used, their masks, and where they were taken from.

    Directions are in the object frame, u = Rᵀ c, R being the rotation of `pose`. Of pictures from the
    same direction the first is kept. Raises BadInput.
    """
    frames = {frame.stamp_ns: frame for frame in recording.frames}
    used = [percept for percept, _ in used_percepts(recording)]
    seen = [percept for percept in used if percept.stamp_ns in frames]
    directions = np.array([percept.view_direction @ pose.rotation for percept in seen]).reshape(-1, 3)
    kept = _distinct(directions)
    if len(kept) < FEWEST_VIEWS:
        raise BadInput(
            f"the recording shows {len(kept)} different views of the object, at least {FEWEST_VIEWS} make a view set: "
            f"{len(used)} looks were used, of {len(seen)} there are pictures"
        )
    with whole_folder(out, force) as folder:
        (folder / "images").mkdir()
        rows = [
            _view(folder, number, frames[seen[k].stamp_ns], directions[k], pictures) for number, k in enumerate(kept)
        ]
        table = io.StringIO(newline="")
        csv.writer(table, lineterminator="\n").writerows([COLUMNS, *rows])
        (folder / "views.csv").write_text(table.getvalue(), encoding="utf-8")
    notes = [f"seen from {pose.name} in its pose at the end of the task"]
    if len(used) > len(seen):
        notes.append(f"{len(used) - len(seen)} looks without a recorded picture are left out")
    if len(seen) > len(kept):
        notes.append(f"{len(seen) - len(kept)} pictures from directions that others show are left out")
    return Exported(len(kept), tuple(notes))


def _view(
    folder: Path, number: int, frame: RecordedFrame, direction: FloatArray, pictures: Pictures
) -> tuple[str, float, float, str]:
    """Write one picture and its mask; its line of the list."""
    image, mask = f"images/{pictures.write(folder / 'images', f'{number:06}', frame)}", ""
    if frame.mask_png is not None:
        mask = f"masks/{number:06}.png"
        (folder / "masks").mkdir(exist_ok=True)
        (folder / mask).write_bytes(frame.mask_png)
    azimuth, elevation = np.degrees(azimuth_elevation(direction)).tolist()
    return image, azimuth, elevation, mask


def _distinct(directions: FloatArray) -> list[int]:
    """Indices of directions (N, 3) in order, without those that an earlier one shows already."""
    kept: list[int] = []
    for index, direction in enumerate(directions):
        if not (angle_between(directions[kept], direction) < SAME_VIEW_RAD).any():
            kept.append(index)
    return kept
