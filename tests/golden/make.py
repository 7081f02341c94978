"""Makes the golden recordings: short tasks with two generated boxes. `make golden` runs it.

That of the present layout is of the seed's method, as those before it; `defaults.mcap` is of the default one.

Recordings of earlier layouts are never made again: they are what those versions wrote.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[1]))
import one_thread  # noqa: F401  before numpy

from viewsep.config import parse_config
from viewsep.learning import learn_object
from viewsep.recordings.reader import read_recording
from viewsep.recordings.replay import verify
from viewsep.recordings.version import VERSION
from viewsep.task import Task, run_task

FOLDER = Path(__file__).parent
SOURCES = {"product_7": "generated:7", "product_7_twin_face": "generated:7:twin=face"}
SETTINGS = {"camera": {"size_px": 80}, "recording": {"keyframe_s": 2.0}, "task": {"pose_tolerance_deg": 4.0}}
SEED_SETTINGS = {
    "camera": {"size_px": 80},
    "descriptor": {"name": "cch"},
    "interpreter": {"name": "path"},
    "planner": {"name": "separating"},
    "recording": {"keyframe_s": 3.0},
}
SEED = 1
LARGEST = 3_000_000


def main() -> None:
    make(FOLDER / f"v{VERSION}.mcap", SEED_SETTINGS)
    make(FOLDER / "defaults.mcap", SETTINGS)


def make(path: Path, settings: Mapping[str, Any]) -> None:
    config = parse_config(settings, "tests/golden/make.py")
    models = [learn_object(source, name, 60, config) for name, source in SOURCES.items()]
    name = "product_7_twin_face"
    run_task(Task(SOURCES[name], name, SEED, path, overwrite=True), config, models)
    found = verify(read_recording(path))
    size = path.stat().st_size
    sys.stdout.write(f"{path.name}: {size} bytes, {found.outputs} outputs of {found.events} events\n")
    if size > LARGEST:
        sys.exit(f"{path.name} is larger than {LARGEST} bytes: make the task shorter")


if __name__ == "__main__":
    main()
