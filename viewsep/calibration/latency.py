"""How late a camera's stamps are and how much play a joint has, from an object that is turned both ways.

Pictures taken at rest, always approached from below, map angles to appearances. What any other picture shows is read
off that map. Turning up, the object is where the map says it is for the encoder's angle, but a late stamp names a later
angle; turning down, the stamp errs to the other side, and the object hangs behind by all of the play. Pictures at rest,
approached from above, show the play alone.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import least_squares
from scipy.stats import t as student

from viewsep.calibration.play import followed
from viewsep.errors import BadInput
from viewsep.messages import Array, BoolArray, FloatArray

LONGEST_S, WIDEST_RAD = 0.5, float(np.radians(10.0))  # latencies and play beyond that are not looked for
FINE_RAD = float(np.radians(0.05))
FEWEST_STOPS, FEWEST_FRAMES, FEWEST_STRETCHES = 8, 30, 4
STRANGE = 3.0  # times the usual distance to the map: a bad frame
SURE = 0.95


@dataclass(frozen=True, eq=False, slots=True)
class AppearanceMap:
    """What rest shows at encoder angles (K,) rising, approached from below: features (K, D)."""

    angle_rad: FloatArray
    feature: Array


@dataclass(frozen=True, eq=False, slots=True)
class Frames:
    """Pictures by stamp: `stamp_ns` (N,), `feature` (N, D), and the `stretch` (N,) of the motion each belongs to."""

    stamp_ns: Array
    feature: Array
    stretch: Array


@dataclass(frozen=True, eq=False, slots=True)
class ReadBacks:
    """One joint's encoder: `stamp_ns` (T,) rising, `angle_rad` (T,)."""

    stamp_ns: Array
    angle_rad: FloatArray


@dataclass(frozen=True, slots=True)
class Interval:
    """A value that lies within `margin` of what was found with 95 %."""

    value: float
    margin: float


@dataclass(frozen=True, slots=True)
class Timing:
    """Stamps are `latency_s` later than the exposures; `play_rad` is the dead band between encoder and object.

    `residual_rad` is how far the `used` frames lie from that on average; `rejected` showed nothing on the map.
    """

    latency_s: Interval
    play_rad: Interval
    residual_rad: float
    used: int
    rejected: int


def agreed(intervals: Sequence[Interval]) -> Interval:
    """One value from several: their mean by certainty, its margin at least what they differ by."""
    values, margins = (np.array(column) for column in zip(*((one.value, one.margin) for one in intervals), strict=True))
    weights = 1.0 / np.maximum(margins, 1e-9) ** 2
    mean = float(weights @ values / weights.sum())
    return Interval(mean, max(float(weights.sum() ** -0.5), float(np.abs(values - mean).max())))


def timing_of(seen: AppearanceMap, frames: Frames, encoder: ReadBacks) -> Timing:
    """Latency and play of one joint. Raises BadInput where there is too little to find them."""
    if len(seen.angle_rad) < FEWEST_STOPS:
        raise BadInput(f"{len(seen.angle_rad)} stops are too few to know the object by: make at least {FEWEST_STOPS}")
    if not np.diff(seen.angle_rad).min() > FINE_RAD:
        raise BadInput("the joint did not come further from one stop to the next: does it turn when it is told to?")
    origin_ns = int(encoder.stamp_ns[0])
    stamps = (frames.stamp_ns - origin_ns) * 1e-9  # ns since boot do not fit a float exactly
    clock = (encoder.stamp_ns - origin_ns) * 1e-9
    shown, usable = shown_angles(seen, frames.feature, np.interp(stamps, clock, encoder.angle_rad))
    usable &= (stamps - LONGEST_S > clock[0]) & (stamps < clock[-1])
    shown, stamps, stretch = shown[usable], stamps[usable], frames.stretch[usable]
    if len(shown) < FEWEST_FRAMES or len(np.unique(stretch)) < FEWEST_STRETCHES:
        raise BadInput(
            f"{len(shown)} of {len(usable)} frames show an angle that was seen at rest; at least {FEWEST_FRAMES} in "
            f"{FEWEST_STRETCHES} stretches are needed: turn an object with print all around, in steady light, further"
        )

    def missed(guess: FloatArray) -> FloatArray:
        latency, play = guess
        held = followed(encoder.angle_rad, max(play, 0.0)) + 0.5 * play
        return np.asarray(shown - np.interp(stamps - latency, clock, held))

    start = np.array([0.02, np.radians(0.5)])
    bounds = ([-LONGEST_S, 0.0], [LONGEST_S, WIDEST_RAD])
    scale = [0.01, np.radians(0.2)]
    for loss in (np.radians(2.0), np.radians(0.1)):  # first whoever is near, then those that agree
        fit = least_squares(
            missed, start, bounds=bounds, x_scale=scale, loss="soft_l1", f_scale=loss, diff_step=[1e-3, 1e-3]
        )
        start = np.clip(fit.x, [-0.49, 1e-6], [0.49, 0.99 * WIDEST_RAD])
    return _timing(fit.x, missed(fit.x), _slopes(missed, fit.x), stretch, int((~usable).sum()), map_error(seen))


def shown_angles(seen: AppearanceMap, feature: Array, near_rad: FloatArray) -> tuple[FloatArray, BoolArray]:
    """(N, D) features -> (N,) the angles at which the map shows the most similar, and which of them can be believed.

    They are searched around `near_rad` (N,), between the map's stops along a smooth curve through its features.
    """
    rising = np.argsort(seen.angle_rad, kind="stable")
    angle, known = seen.angle_rad[rising], np.asarray(seen.feature[rising], np.float64)
    curve = CubicSpline(angle, known)
    grid = np.arange(angle[0], angle[-1], FINE_RAD)
    on_grid = np.asarray(curve(grid))
    looks = np.asarray(feature, np.float64)
    distance2 = (on_grid * on_grid).sum(axis=1) - 2.0 * looks @ on_grid.T  # of each look up to its own length
    reach = WIDEST_RAD + LONGEST_S * np.radians(60.0)
    distance2[np.abs(grid - near_rad[:, None]) > reach] = np.inf
    best = np.argmin(distance2, axis=1)
    inner = np.clip(best, 1, len(grid) - 2)
    before, here, after = (distance2[np.arange(len(looks)), inner + step] for step in (-1, 0, 1))
    bend = before - 2.0 * here + after
    with np.errstate(invalid="ignore", divide="ignore"):
        shift = np.where(np.isfinite(bend) & (bend > 0.0), 0.5 * (before - after) / bend, 0.0)
    found = grid[inner] + np.clip(shift, -1.0, 1.0) * FINE_RAD
    gap = np.linalg.norm(looks - np.asarray(curve(found)), axis=1)
    margin = FINE_RAD * 2.0
    inside = (found > angle[0] + margin) & (found < angle[-1] - margin) & (np.abs(found - near_rad) < reach - margin)
    usual = float(np.median(gap[inside])) if inside.any() else 0.0
    return found, inside & (gap <= STRANGE * usual + 1e-12)


def map_error(seen: AppearanceMap) -> float:
    """How far from the truth angles between stops are about: from stops that are read off a map without them.

    There the stops lie twice as far apart; half of the error or less remains at their true distance.
    """
    errors = []
    for left_out in range(1, len(seen.angle_rad) - 1):
        kept = np.arange(len(seen.angle_rad)) != left_out
        there = seen.angle_rad[left_out : left_out + 1]
        without = AppearanceMap(seen.angle_rad[kept], seen.feature[kept])
        errors.append(float(shown_angles(without, seen.feature[left_out : left_out + 1], there)[0][0] - there[0]))
    return 0.5 * float(np.median(np.abs(errors)))


def _slopes(missed: Callable[[FloatArray], FloatArray], at: FloatArray) -> FloatArray:
    """(N, 2) how the misses change with latency and play."""
    steps = np.array([1e-3, np.radians(0.02)])
    columns = []
    for k, step in enumerate(steps):
        aside = np.zeros(2)
        aside[k] = step
        columns.append((missed(at + aside) - missed(at - aside)) / (2.0 * step))
    return np.stack(columns, axis=1)


def _timing(
    found: FloatArray, miss: FloatArray, slopes: FloatArray, stretch: Array, rejected: int, off_rad: float
) -> Timing:
    """With intervals that take all frames of a stretch to err alike (sandwich estimate over stretches).

    `off_rad` is what the map may be wrong by everywhere: more frames do not help against that.
    """
    limit = 4.0 * 1.4826 * float(np.median(np.abs(miss))) + 1e-12
    kept = np.abs(miss) <= limit
    inverse = np.linalg.pinv(slopes[kept].T @ slopes[kept])
    groups = [kept & (stretch == one) for one in np.unique(stretch[kept])]
    pushes = np.array([slopes[group].T @ miss[group] for group in groups])
    count = len(groups)
    spread = inverse @ (pushes.T @ pushes) @ inverse * count / max(count - 2, 1)
    margin = student.ppf(0.5 + SURE / 2.0, max(count - 2, 1)) * np.sqrt(np.diag(spread))
    speed = float(np.abs(slopes[kept, 0]).max())
    margin += np.array([off_rad / max(speed, 1e-6), off_rad])
    return Timing(
        Interval(float(found[0]), float(margin[0])),
        Interval(float(found[1]), float(margin[1])),
        float(np.sqrt(np.mean(miss[kept] ** 2))),
        int(kept.sum()),
        rejected + int((~kept).sum()),
    )
