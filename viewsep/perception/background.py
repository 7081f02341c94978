"""The ground learned from pictures of the empty rig, static or by joint angle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from viewsep.errors import BadInput
from viewsep.messages import Array, FloatArray
from viewsep.perception.angles import Angles
from viewsep.perception.boxes import Box, around
from viewsep.perception.ground import Difference
from viewsep.perception.light import gains, places, samples, scaled
from viewsep.perception.shadow import shaded_print, soft_shadow

SMOOTH = (3, 3)
SHAKE = np.ones((3, 3), np.uint8)  # the camera may be off by a pixel
TOLERANCE = 4.0  # grey levels, beside what noise explains
NOISE_MULTIPLE = 3.5
LARGEST_MISMATCH = 0.25  # of the picture away from the object
FEWEST_SAMPLES = 100
CLIPPED = 251.0  # grey levels: as bright or brighter


@dataclass(frozen=True, eq=False)
class BackgroundModel:
    """What the empty rig looks like.

    `still` (H, W, 3) uint8 is its smoothed picture, of which all within `moving` depends on the joints: `turning`
    (K, h, w, 3) uint8 has that part at the K captured `angles`. `noise` is the smoothed pictures' standard deviation in
    grey levels. A static background has one capture and `moving` None.
    """

    still: Array
    moving: Box | None
    turning: Array
    angles: Angles
    noise: float

    @property
    def tolerance(self) -> int:
        """Grey levels by which a smoothed picture may be off."""
        return round(TOLERANCE + NOISE_MULTIPLE * self.noise)

    @cached_property
    def still_bounds(self) -> tuple[Array, Array]:
        """The darkest and the brightest (H, W, 3) that a shaking camera sees."""
        return _bounds(self.still, self.still, self.tolerance)

    @cached_property
    def still_samples(self) -> tuple[Array, Array, Array]:
        """Samples (N, 3) of the still picture and of its bounds, where they are quick to get at."""
        low, high = self.still_bounds
        return samples(self.still).copy(), samples(low).copy(), samples(high).copy()


def learn_background(
    frames: Sequence[tuple[Array, Sequence[float]]], turns: Sequence[bool] | None = None
) -> BackgroundModel:
    """From pictures (H, W, 3) uint8 RGB of the empty rig with their joint angles (n,), NaN of joints that do not show.

    Pictures at the same angles are averaged, those of different exposure evened out. `turns` names the joints for which
    a whole turn changes nothing (by default all). All at the same angles make a static background. Raises BadInput.
    """
    if not frames:
        raise BadInput("no pictures of the empty rig: a background is learned from at least one")
    shapes = {image.shape for image, _ in frames}
    if len(shapes) > 1:
        raise BadInput(f"pictures of the empty rig have different sizes: {sorted(shapes)}; capture them again")
    even = _evened([image for image, _ in frames])
    joints = np.array([list(angles) for _, angles in frames], float).reshape(len(frames), -1)
    places, member = np.unique(np.nan_to_num(joints).round(6), axis=0, return_inverse=True)
    places[:, np.isnan(joints).all(axis=0)] = np.nan
    member = member.reshape(-1)
    pictures = [_mean([even[k] for k in np.flatnonzero(member == place)]) for place in range(len(places))]
    noise = _noise(even, member)
    moving = _moving(pictures, TOLERANCE + NOISE_MULTIPLE * noise)
    angles = Angles(places, np.ones(joints.shape[1], bool) if turns is None else np.array(turns, bool))
    if moving is None:
        still = _mean(pictures)
        return BackgroundModel(still, None, np.zeros((1, 0, 0, 3), np.uint8), Angles(places[:1], angles.turns), noise)
    return BackgroundModel(_mean(pictures), moving, np.stack([p[moving.part] for p in pictures]), angles, noise)


@dataclass(frozen=True, slots=True)
class Background:
    """`Ground` by a background model. Its pictures show the holder, so what hides the object there is no object."""

    model: BackgroundModel
    shows_holder: bool = True

    def difference(self, image: Array, joints: Sequence[float], box: Box) -> Difference:
        """Where a picture differs from the empty rig's, the light evened out and soft shadows left out."""
        model = self.model
        if image.shape != model.still.shape:
            raise BadInput(
                f"the picture is {image.shape[1]} x {image.shape[0]}, but the background was captured at "
                f"{model.still.shape[1]} x {model.still.shape[0]} pixels: capture it again with this camera"
            )
        near, beyond = model.angles.nearest(joints) if model.moving is not None else ([0], 0.0)
        gain, mismatch = self._light(image, box)
        mean, lower, upper = self._expected(near, box)
        even = scaled(cv2.blur(image[box.part], SMOOTH), 1.0 / gain)
        if gain.max() > 1.0:  # what was clipped may have been as bright as the background
            lower = _at_most(lower, np.floor(CLIPPED / gain) - model.tolerance)
        within: Array = np.asarray(cv2.inRange(even, lower, upper))
        shadow = soft_shadow(even, mean)
        shadow |= shaded_print(even, lower, upper, shadow, mean)
        return Difference((~within >> 7) & ~shadow, shadow, _problem(beyond, mismatch), gain)

    def _expected(self, near: Sequence[int], box: Box) -> tuple[Array, Array, Array]:
        """What is seen in the box at the captures `near`: mean, darkest, brightest (h, w, 3) uint8."""
        model, (low, high) = self.model, self.model.still_bounds
        mean, lower, upper = model.still[box.part], low[box.part], high[box.part]
        if model.moving is None:
            return mean, lower, upper
        common, inner = _intersection(box, model.moving)
        if common is None or inner is None:
            return mean, lower, upper
        seen = [model.turning[k][inner.part] for k in near]
        darkest, brightest = seen[0], seen[0]
        for other in seen[1:]:
            darkest, brightest = cv2.min(darkest, other), cv2.max(brightest, other)
        turning = (seen[0], *_bounds(darkest, brightest, model.tolerance))
        if seen[0].shape == mean.shape:  # all of the box turns
            return turning
        mean, lower, upper = (
            _pasted(still, part, common) for still, part in zip((mean, lower, upper), turning, strict=True)
        )
        return mean, lower, upper

    def _light(self, image: Array, box: Box) -> tuple[FloatArray, float]:
        """(3,) how much brighter the picture is than the model, and the share of it that does not fit all the same.

        Taken away from the box, where the object is, and from what moves with the joints.
        """
        model = self.model
        away = _away(model.still.shape[:2], box if _covers_little(box, image.shape[:2]) else None, model.moving)
        seen, still, low, high = (sample.take(away, axis=0) for sample in (samples(image), *model.still_samples))
        gain = gains(seen, still)
        room = 2.0 * NOISE_MULTIPLE * model.noise  # more, as these pixels are not smoothed
        darkest = np.minimum(low * gain, CLIPPED) - room
        brightest = high * gain + room
        fits = (seen >= darkest) & (seen <= brightest)
        return gain, 1.0 - float((fits[:, 0] & fits[:, 1] & fits[:, 2]).mean())


def changed_shares(images: Sequence[Array], noise: float = 2.0) -> list[float]:
    """Which share of each picture (H, W, 3) but the first differs from that by more than light and `noise` explain."""
    first, *others = _evened(images)
    lower, upper = _bounds(first, first, round(TOLERANCE + NOISE_MULTIPLE * noise))
    clipped = [_clipped(image) for image in images]
    return [
        float((_beyond(picture, lower, upper) > clipped[0] + bright).mean())
        for picture, bright in zip(others, clipped[1:], strict=True)
    ]


def _clipped(image: Array) -> Array:
    """(H, W) int, 255 at and around what is too bright to compare."""
    return np.asarray(cv2.dilate(np.asarray(image.max(axis=2) >= CLIPPED, np.uint8), SHAKE)).astype(int) * 255


def _evened(images: Sequence[Array]) -> list[Array]:
    """Smoothed, and all as bright as the first."""
    smooth = [cv2.blur(image, SMOOTH) for image in images]
    return [scaled(picture, 1.0 / gains(samples(picture), samples(smooth[0]))) for picture in smooth]


def _beyond(picture: Array, lower: Array, upper: Array) -> Array:
    """(H, W) uint8, 255 where a picture is not between the two, single lines left out."""
    within: Array = np.asarray(cv2.inRange(picture, lower, upper))
    return np.asarray(cv2.morphologyEx(~within, cv2.MORPH_OPEN, SHAKE))


def _problem(beyond: float, mismatch: float) -> str:
    if beyond > 0.0:
        return (
            f"the empty rig was not captured near these joint angles ({np.degrees(beyond):.0f} deg further than its "
            "captures explain): capture it there, too"
        )
    if mismatch > LARGEST_MISMATCH:
        return (
            f"{mismatch:.0%} of the picture around the object is not as it was when the empty rig was captured: the "
            "light or the camera changed; capture it again"
        )
    return ""


def _covers_little(box: Box, shape: tuple[int, ...]) -> bool:
    return (box.right - box.left) * (box.bottom - box.top) < 0.7 * shape[0] * shape[1]


def _away(shape: tuple[int, ...], *boxes: Box | None) -> Array:
    """Indices of the samples of a picture of `shape` that lie in none of the boxes; all where that leaves too few."""
    rows, columns = places(shape[0]), places(shape[1])
    free = np.ones((len(rows), len(columns)), bool)
    for box in boxes:
        if box is not None:
            across = (rows >= box.top) & (rows < box.bottom)
            free[np.ix_(across, (columns >= box.left) & (columns < box.right))] = False
    found = np.flatnonzero(free)
    return found if len(found) >= FEWEST_SAMPLES else np.arange(free.size)


def _intersection(box: Box, other: Box) -> tuple[Box | None, Box | None]:
    """What two boxes share, in the pixels of either; None where they share nothing."""
    left, top = max(box.left, other.left), max(box.top, other.top)
    right, bottom = min(box.right, other.right), min(box.bottom, other.bottom)
    if left >= right or top >= bottom:
        return None, None
    a, b = (
        Box(left - origin.left, top - origin.top, right - origin.left, bottom - origin.top) for origin in (box, other)
    )
    return a, b


def _pasted(still: Array, part: Array, box: Box) -> Array:
    """A picture with a part of another in a box of it."""
    picture = np.empty_like(still)
    picture[: box.top], picture[box.bottom :] = still[: box.top], still[box.bottom :]
    if box.right - box.left < picture.shape[1]:
        picture[box.top : box.bottom] = still[box.top : box.bottom]
    picture[box.part] = part
    return picture


def _mean(pictures: Sequence[Array]) -> Array:
    if len(pictures) == 1:
        return pictures[0]
    total = np.zeros(pictures[0].shape, np.float32)
    for picture in pictures:
        total += picture
    return np.rint(total / len(pictures)).astype(np.uint8)


def _noise(pictures: Sequence[Array], member: Array) -> float:
    """Standard deviation of a smoothed picture, from pairs at the same angles or, without any, of neighbours."""
    pairs = [(a, a + 1) for a in range(len(pictures) - 1) if member[a] == member[a + 1]]
    pairs = (pairs or [(a, a + 1) for a in range(len(pictures) - 1)])[:8]
    apart = [cv2.absdiff(pictures[a], pictures[b])[::2, ::2].astype(np.float32) for a, b in pairs]
    usual = [float(levels[levels <= 4.0 + 4.0 * np.median(levels)].mean()) for levels in apart]  # the rest has moved
    return float(np.median(usual) * np.sqrt(np.pi) / 2.0) if usual else 1.0  # of a difference's mean size


def _moving(pictures: Sequence[Array], tolerance: float) -> Box | None:
    """The box of what changes from capture to capture by more than the camera's shaking explains."""
    if len(pictures) < 2:
        return None
    lower, upper = _bounds(pictures[0], pictures[0], round(tolerance))
    height, width = pictures[0].shape[:2]
    changes: Array = np.zeros((height, width), np.uint8)
    for picture in pictures[1:]:
        within: Array = np.asarray(cv2.inRange(picture, lower, upper))
        changes = changes | ~within
    box = around(np.asarray(cv2.morphologyEx(changes, cv2.MORPH_OPEN, SHAKE)))
    return None if box is None else box.grown(4, (height, width))


def _bounds(darkest: Array, brightest: Array, tolerance: int) -> tuple[Array, Array]:
    """What a shaking camera may see of pictures between these two, all (h, w, 3) uint8."""
    room = np.full(4, float(tolerance))
    return cv2.subtract(cv2.erode(darkest, SHAKE), room), cv2.add(cv2.dilate(brightest, SHAKE), room)


def _at_most(picture: Array, most: FloatArray) -> Array:
    """A picture (h, w, 3) with every channel cut off at `most` (3,)."""
    return np.asarray(cv2.min(picture, np.append(np.maximum(most, 0.0), 0.0)))
