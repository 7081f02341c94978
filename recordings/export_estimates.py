"""The estimates of a recording as a table, one line per estimate and candidate."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from viewsep.account import NONE_OF_THEM
from viewsep.errors import BadInput
from viewsep.files import write_whole
from viewsep.geometry import azimuth_elevation, matrix_to_quaternion
from viewsep.messages import Estimate, FloatArray
from viewsep.recordings.camera_poses import used_percepts
from viewsep.recordings.export import Exported, check_free
from viewsep.recordings.reader import Recording

COLUMNS = (
    "time_s",
    "iteration",
    "phase",
    "candidate",
    "rating",
    "w0",
    "w1_deg",
    "w2",
    "spread_deg",
    "qx",
    "qy",
    "qz",
    "qw",
    "azimuth_deg",
    "elevation_deg",
    "travel_deg",
    "probability",
)


def export_estimates(recording: Recording, out: Path, force: bool) -> Exported:
    """Write the CSV file `out`. Raises BadInput.

    Times count from the recording's first message, the view's angles are those of c in the control frame, the
    quaternion is the pose object -> control, and the spread is the root of the pose's variance. A number that is not
    finite, or not known, leaves its cell empty. Where the interpreter has probabilities, a line for none of the
    candidates follows theirs.
    """
    check_free(out, force)
    if out.is_dir():
        raise BadInput(f"{out}: is a folder; give the name of a file")
    if not out.parent.is_dir():
        raise BadInput(f"{out}: the folder {out.parent} does not exist; create it")
    start_ns = min((recorded.stamp_ns for recorded in recording.messages), default=0)
    rows = [
        row
        for percept, estimate in used_percepts(recording)
        for row in _rows(estimate, percept.view_direction, (percept.stamp_ns - start_ns) / 1e9)
    ]
    if not rows:
        raise BadInput("the recording holds no estimates; choose another recording")
    table = io.StringIO(newline="")
    csv.writer(table, lineterminator="\n").writerows([COLUMNS, *rows])
    write_whole(out, table.getvalue().encode(), "table")
    return Exported(len(rows))


def _rows(estimate: Estimate, view_direction: FloatArray, time_s: float) -> Iterator[list[object]]:
    view = np.degrees(azimuth_elevation(view_direction)).tolist()
    for candidate in estimate.candidates:
        numbers = (candidate.rating, candidate.w0, np.degrees(candidate.w1), candidate.w2)
        spread = np.degrees(np.sqrt(candidate.variance))
        quaternion = matrix_to_quaternion(candidate.rotation).tolist()
        yield [
            *(time_s, estimate.iteration, estimate.phase.value, candidate.name),
            *(_cell(number) for number in (*numbers, spread, *quaternion, *view, np.degrees(estimate.travel_rad))),
            _cell(candidate.probability),
        ]
    if estimate.unknown is not None:
        said = {
            **{"time_s": time_s, "iteration": estimate.iteration, "phase": estimate.phase.value},
            **{"candidate": NONE_OF_THEM, "azimuth_deg": view[0], "elevation_deg": view[1]},
            **{"travel_deg": float(np.degrees(estimate.travel_rad)), "probability": estimate.unknown},
        }
        yield [said.get(column, "") for column in COLUMNS]


def _cell(number: float | None) -> float | str:
    return "" if number is None or not np.isfinite(number) else float(number)
