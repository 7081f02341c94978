"""The whole chain without any given mask or pose.

The empty rig is captured, objects are learned on the rig, put back as it happens, and separated; the camera is staged,
with desk, plate and shadow, and the turntable's servos are emulated.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from viewsep.assembly import make_engine
from viewsep.bench.journal import Row
from viewsep.bench.summary import verdict
from viewsep.bench.tasks import SeparationTask, names_of
from viewsep.built_rig import SimulatedRig
from viewsep.calibration.compensation import compensated
from viewsep.camera_config import StageConfig
from viewsep.capture.empty import capture_empty
from viewsep.capture.lesson import Lesson, learn_from_placements, photograph
from viewsep.config import Config, parse_config
from viewsep.errors import RigError
from viewsep.framing import FRAME_FILL
from viewsep.geometry import rotation_angle
from viewsep.messages import FloatArray, FrameMissing, Message
from viewsep.models.aspect_graph import AspectGraph
from viewsep.perception import RigPerception
from viewsep.perception.background import learn_background
from viewsep.perception.setup import finder_of
from viewsep.perception.stored import save_background
from viewsep.plugins import make_descriptor
from viewsep.rigs import empty_rig, pace_of, simulated_rig
from viewsep.session import Session
from viewsep.sim.render_cache import RenderCache

RigName = Literal["turntable", "pan_tilt"]
RIGS: tuple[RigName, ...] = ("turntable", "pan_tilt")
ROTATIONS, UPRIGHT_WITHIN_DEG = 40_000, 15.0  # as `viewsep rig init` writes them
PLACEMENTS: dict[RigName, int] = {"turntable": 1, "pan_tilt": 2}  # in which every object is learned


@dataclass(frozen=True, eq=False, slots=True)
class Learned:
    """An object that was learned on the rig, and how the photos went.

    The model's frame is the control frame of the first placement; there it was held in `rotation` (3, 3).
    """

    model: AspectGraph
    rotation: FloatArray
    photos: int
    skipped: int

    def as_row(self) -> dict[str, Any]:
        """For JSON."""
        views = len(self.model.directions)
        return {"name": self.model.name, "views": views, "photos": self.photos, "skipped": self.skipped}


def chain_config(
    rig: RigName, background: Path, speed: float, changes: dict[str, Any] | None = None, *, servos: bool = True
) -> Config:
    """The configuration of the chain: emulated `servos` turn the plate at `speed` times the wall's time.

    Pan and tilt are simulated. `changes` are further sections, or other ones.
    """
    options: dict[str, Any] = {"rotations": ROTATIONS}
    radius_px = round(0.5 * FRAME_FILL * StageConfig().object_px)  # the camera stays, so does its scale
    table: dict[str, Any] = {
        "rig": {"preset": rig},
        "camera": {"source": "staged"},
        "perception": {"method": "background", "background": str(background), "object_radius_px": radius_px},
        "interpreter": {"options": options},
    }
    if rig == "turntable":
        table["sim"] = {"placed": "standing"}
        options["upright_within_deg"] = UPRIGHT_WITHIN_DEG
    if rig == "turntable" and servos:
        servo = {"joint": "pan", "id": 1, "mode": "extended"}
        bus = {"port": "emulated", "baud": 1_000_000, "emulated_speed": speed, "watchdog_s": 0.0, "lost_s": 5.0}
        table["rig"]["backend"] = "dynamixel"
        table["dynamixel"] = {**bus, "servos": [servo]}
    return parse_config({**table, **(changes or {})}, "the chain's configuration")


@dataclass(frozen=True)
class Chain:
    """One rig, its files in `folder`, and what is done on it; all that is left to chance follows from `seed`."""

    config: Config
    folder: Path
    seed: int
    placements: int
    spacing_deg: float = 10.0
    trials: float = 1.5  # further photos between the views, as a share of those
    every_deg: float = 3.0  # between pictures of the empty rig
    cache: RenderCache | None = None

    def capture_empty(self, heard: Callable[[int], None] = lambda count: None) -> int:
        """Capture the empty rig; how many pictures it took. `heard` is told how many there will be."""
        rig = compensated(empty_rig(self.config, self._chance(0)).rig, self.config)
        empty = capture_empty(rig, None, float(np.radians(self.every_deg)), heard)
        save_background(learn_background(empty.pictures), Path(self.config.perception.background))
        return len(empty.pictures)

    def learn(self, source: str, name: str) -> Learned:
        """Photograph an object in its placements, and learn it from the photos. Raises RigError, BadInput."""
        lesson = Lesson(name, self.folder / f"{name}.photos", spacing_deg=self.spacing_deg, trials=self.trials)
        rotations, photos, skipped = [], 0, 0
        for placement in range(1, self.placements + 1):
            held = self._holding(source, self._chance(placement, *name.encode()))
            perception = self._perception(held)
            missed, taken = photograph(replace(lesson, placement=placement), held.rig, perception, "the chain's")
            rotations.append(held.true_rotation(0))
            photos, skipped = photos + taken, skipped + len(missed)
        model, _ = learn_from_placements(lesson, self.config)
        return Learned(model, rotations[0], photos, skipped)

    def separate(self, task: SeparationTask, learned: Sequence[Learned]) -> Row:
        """Put the object back as the task's seed says, separate it from the others, and score the answer."""
        truth = next(one for one in learned if one.model.name == task.truth)
        held, refused, began_s = self._holding(task.source, task.seed), Refusals(), time.monotonic()
        row: Row = {"index": task.index, "seed": task.seed, "truth": task.truth, "candidates": len(learned)}
        engine = make_engine(self.config, [one.model for one in learned])
        try:
            with Session(held.rig, engine, self._perception(held), pace_of(self.config), [refused]) as session:
                result = session.run(task.seed)
        except RigError as error:
            return row | {"outcome": "failed", "verdict": "failed", "object": "", "reason": str(error)}
        stood = held.true_rotation(result.stamp_ns) @ truth.rotation.T
        right = result.object == task.truth
        return row | {
            "outcome": result.outcome.value,
            "object": result.object,
            "reason": result.reason,
            "verdict": verdict(result.outcome.value, result.object, task.truth, known=True),
            "looks": result.looks,
            "refused": refused.sentences,
            "travel_deg": float(np.degrees(result.travel_rad)),
            "pose_error_deg": float(np.degrees(rotation_angle(result.rotation, stood))) if right else None,
            "wall_s": time.monotonic() - began_s,
        }

    def _holding(self, source: str, seed: int) -> SimulatedRig:
        return simulated_rig(self.config, source, seed, self.cache)

    def _perception(self, held: SimulatedRig) -> RigPerception:
        rig = compensated(held.rig, self.config)
        return RigPerception(rig, make_descriptor(self.config.descriptor), finder_of(self.config))

    def _chance(self, *purpose: int) -> int:
        return int(np.random.default_rng([self.seed, 32, *purpose]).integers(2**62))


@dataclass(frozen=True, eq=False, slots=True)
class ChainRun:
    """What came of it: pictures of the empty rig, the objects learned, and a row for each task."""

    empty_pictures: int
    learned: list[Learned]
    rows: list[Row]

    def as_row(self) -> dict[str, Any]:
        """For JSON."""
        learned = [one.as_row() for one in self.learned]
        return {"empty_pictures": self.empty_pictures, "learned": learned, "tasks": self.rows}


def run_chain(chain: Chain, tasks: Sequence[SeparationTask], heard: Callable[[], None] = lambda: None) -> ChainRun:
    """Capture the empty rig, learn what the tasks are about, and carry them out; `heard` is told of each.

    Raises RigError, BadInput where that is not possible; a rig that fails in a task is a failed task.
    """
    pictures = chain.capture_empty()
    learned: dict[str, Learned] = {}
    for source, name in names_of(sorted({source for task in tasks for source in task.candidates})).items():
        learned[source] = chain.learn(source, name)
        heard()
    rows = []
    for task in tasks:
        rows.append(chain.separate(task, [learned[source] for source in task.candidates]))
        heard()
    return ChainRun(pictures, list(learned.values()), rows)


class Refusals:
    """A listener that counts the looks without a percept, by what was said."""

    def __init__(self) -> None:
        self.sentences: dict[str, int] = {}

    def hear(self, stamp_ns: int, message: Message) -> None:
        """Note it."""
        if isinstance(message, FrameMissing):
            self.sentences[message.reason] = self.sentences.get(message.reason, 0) + 1
