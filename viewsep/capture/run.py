"""Driving the rig from shot to shot and keeping what it sees there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from viewsep.capture.folder import CaptureFolder
from viewsep.capture.plan import Shot
from viewsep.capture.quality import photo_quality
from viewsep.errors import RigError, Timeout
from viewsep.interfaces import Perception
from viewsep.messages import JointState
from viewsep.moves import move_and_wait
from viewsep.perception.exposure import too_dark
from viewsep.session import SETTLED_RAD, Rig

SETTLE_S = 0.2  # after the joints have come to rest: what they hold swings on
FRAME_TIMEOUT_S = 2.0
ATTEMPTS = 3
STEADY = 1.25  # what is as little sharp at every attempt has no print there; shaking blurs by chance
PREVIEW_EVERY = 10
FEWEST_TRIED, WORST_SHARE = 6, 0.5  # when so many shots in so large a part failed, something is wrong with all
IN_A_ROW = 10  # or so many one after the other, as when the object is gone


@dataclass(frozen=True, slots=True)
class Skipped:
    """A shot without a usable photo, and why."""

    number: int
    problem: str


def take_photos(
    rig: Rig,
    perception: Perception,
    shots: Sequence[Shot],
    folder: CaptureFolder,
    tick: Callable[[str], None] = lambda problem: None,
    watch: Callable[[JointState], None] = lambda state: None,
) -> list[Skipped]:
    """Take the photos that are not there yet. What could not be used after some attempts is skipped and told.

    `tick` hears of every shot, with what was wrong with it; `watch` hears every read-back and stops all by raising.
    Raises RigError, also when most shots fail or many in a row, and when no picture comes at all.
    """
    skipped: list[Skipped] = []
    in_a_row = 0
    wanted = [shot for shot in shots if shot.number not in folder.done]
    for tried, shot in enumerate(wanted, start=1):
        problem = _take(rig, perception, shot, folder, watch)
        if problem:
            skipped.append(Skipped(shot.number, problem))
        in_a_row = in_a_row + 1 if problem else 0
        if tried >= FEWEST_TRIED and len(skipped) > WORST_SHARE * tried:
            raise RigError(f"{len(skipped)} of {tried} photos could not be used, the last one: {skipped[-1].problem}")
        if in_a_row >= IN_A_ROW:
            raise RigError(f"{in_a_row} photos in a row could not be used, the last one: {problem}")
        if tried % PREVIEW_EVERY == 0:
            folder.preview()
        tick(problem)
    return skipped


def _take(
    rig: Rig, perception: Perception, shot: Shot, folder: CaptureFolder, watch: Callable[[JointState], None]
) -> str:
    """Drive to a shot and photograph it; what is wrong with the last attempt, or nothing."""
    near = rig.motion.read_state().position_rad
    goal = rig.geometry.joints_for(shot.direction, near)
    _, rested = move_and_wait(rig.motion, rig.clock, goal, watch, SETTLED_RAD)
    rig.clock.sleep_until(rested.stamp_ns + round(SETTLE_S * 1e9))
    newer_than_ns, problem, silent = rig.clock.now_ns(), "", 0
    sharpness: list[float] = []
    for _ in range(ATTEMPTS):
        try:
            look = perception.look(newer_than_ns, FRAME_TIMEOUT_S)
        except Timeout as error:
            problem, silent = str(error), silent + 1
            continue
        newer_than_ns = look.stamp_ns
        if look.percept is None or look.frame is None or look.frame.mask is None:
            problem = look.problem or "there is no mask of the object"
            continue
        quality = photo_quality(look.frame.image, look.frame.mask)
        sharpness.append(quality.sharpness)
        plain = len(sharpness) == ATTEMPTS and max(sharpness) < STEADY * min(sharpness)
        others = [] if plain else [photo.quality.sharpness for photo in folder.photos]
        problem = quality.problem(others) or too_dark(look.frame.image)
        if not problem:
            folder.add(shot, look.percept.view_direction, look.frame, quality)
            return ""
    if silent == ATTEMPTS:
        raise RigError(f"no picture came in {ATTEMPTS} attempts: {problem}; is the camera plugged in?")
    return problem
