"""Where a rig's axes and its camera are, from a printed ChArUco board on the plate, seen at several joint angles.

The board's corners move as the rig says: X(q) = p + Rot(a_1, q_1) ... Rot(a_n, q_n) (Y - p), all axes a_k through one
point p, Y the corner at q = 0, all in the camera's frame. Axes, point, the board's place and, if wanted, the lens are
those that fit all corners in all pictures best.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from viewsep.calibration.lens import Lens
from viewsep.errors import BadInput
from viewsep.geometry import axis_rotation, unit
from viewsep.messages import Array, FloatArray

FEWEST_CORNERS, FEWEST_ANGLES = 8, 4
WIDEST_RAD = float(np.radians(30.0))  # each joint must turn by that at least
STILL_RAD = float(np.radians(0.5))
FURTHEST_RAD = float(np.radians(170.0))  # half a turn has no direction
LARGEST_PX = 2.0  # of a residual: a picture that fits worse does not belong to its angles


@dataclass(frozen=True, slots=True)
class Board:
    """A ChArUco board: `columns` x `rows` squares of `square_m`, with markers of `marker_share` of it inside."""

    columns: int = 7
    rows: int = 5
    square_m: float = 0.02
    marker_share: float = 0.75

    def charuco(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's."""
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square_m, self.marker_share * self.square_m, dictionary)

    def picture(self, dots_per_inch: float, margin_m: float = 0.0) -> Array:
        """(H, W) uint8 to be printed at this resolution without scaling."""
        per_m = dots_per_inch / 0.0254
        margin = round(margin_m * per_m)
        wide, high = (round(count * self.square_m * per_m) + 2 * margin for count in (self.columns, self.rows))
        return np.asarray(self.charuco().generateImage((wide, high), marginSize=margin))


@dataclass(frozen=True, eq=False, slots=True)
class Sighting:
    """The board in one picture: joint angles (n,), corners (C, 2) in pixels and on the board (C, 3) in metres."""

    position_rad: tuple[float, ...]
    pixel: FloatArray
    corner: FloatArray


@dataclass(frozen=True, eq=False, slots=True)
class RigPlacement:
    """What the board says of a rig.

    `axes` (n, 3) in the world frame at zero: z is the last axis, on the printed side, the camera at azimuth 0;
    `centre_m` (3,) is where the last axis meets the board, raised by the height that was asked for, and `camera_axes`
    (n, 3) the axes, both in the camera's frame. `elevation_margin_rad` holds with 95 %; `residual_px` is the root mean
    square over all corners, `worst_px` that of the worst of the `pictures`. `turns_back` says that the last joint turns
    against the printed side's normal.
    """

    axes: FloatArray
    camera_elevation_rad: float
    elevation_margin_rad: float
    camera_axes: FloatArray
    centre_m: FloatArray
    turns_back: bool
    lens: Lens
    residual_px: float
    worst_px: float
    pictures: int


def sight(board: Board, image: Array, position_rad: Sequence[float]) -> Sighting | None:
    """The board in a picture (H, W, 3) or (H, W) uint8, None where too little of it is seen."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image
    charuco = board.charuco()
    corners, numbers, _, _ = cv2.aruco.CharucoDetector(charuco).detectBoard(grey)
    if corners is None or numbers is None or len(corners) < FEWEST_CORNERS:
        return None
    at = np.asarray(charuco.getChessboardCorners(), np.float64)[np.ravel(numbers)]
    return Sighting(tuple(position_rad), np.asarray(corners, np.float64).reshape(-1, 2), at)


def placement_of(
    sightings: Sequence[Sighting], lens: Lens, *, free_lens: bool = False, height_m: float = 0.0
) -> RigPlacement:
    """Axes and camera of the rig. `lens` is the camera's, or with `free_lens` a first guess that is fitted, too.

    The joints are to be turned one by one, the others resting where they are in the first picture. `height_m` is how
    far above the board the objects' centres will be. Raises BadInput where there is too little to work it out.
    """
    if len(sightings) < FEWEST_ANGLES:
        raise BadInput(
            f"the board is seen in {len(sightings)} pictures, at least {FEWEST_ANGLES} are needed: light it evenly, "
            "print it sharp, and turn the plate so that the camera sees it"
        )
    start = _start(sightings, lens)
    joints = len(sightings[0].position_rad)
    first = np.concatenate([start, lens.numbers()]) if free_lens else start

    def missed(guess: FloatArray) -> FloatArray:
        return _missed(guess, joints, sightings, lens)

    fit = least_squares(missed, first, x_scale="jac", loss="soft_l1", f_scale=1.0)
    miss = missed(fit.x).reshape(-1, 2)
    ends = np.cumsum([len(sighting.pixel) for sighting in sightings])
    each = [float(np.sqrt((part**2).sum(axis=1).mean())) for part in np.split(miss, ends[:-1])]
    if max(each) > LARGEST_PX:
        raise BadInput(
            f"picture {int(np.argmax(each)) + 1} fits the others by {max(each):.1f} pixels only (at most {LARGEST_PX:g}"
            "): check its joint angles, that the board lies flat and did not slip, and the lens"
        )
    noise2 = float((miss**2).sum()) / max(miss.size - len(fit.x), 1)
    jacobian = np.asarray(fit.jac, np.float64)
    covariance = noise2 * np.linalg.pinv(jacobian.T @ jacobian)
    slope = np.array([_elevation_slope(fit.x, joints, height_m, k) for k in range(len(fit.x))])
    margin = 1.96 * float(np.sqrt(max(slope @ covariance @ slope, 0.0)))
    axes, _, _ = _parts(fit.x, joints)
    up, place = _up_and_centre(fit.x, joints, height_m)
    forward = -unit(place)
    side = unit(forward - (forward @ up) * up)
    world = np.stack([side, np.cross(up, side), up])
    return RigPlacement(
        axes=axes @ world.T,
        camera_elevation_rad=_elevation(fit.x, joints, height_m),
        elevation_margin_rad=margin,
        camera_axes=axes,
        centre_m=place,
        turns_back=bool(axes[-1] @ up < 0.0),
        lens=Lens.of(fit.x[len(start) :], lens.width, lens.height) if free_lens else lens,
        residual_px=float(np.sqrt((miss**2).sum(axis=1).mean())),
        worst_px=max(each),
        pictures=len(sightings),
    )


def _parts(guess: FloatArray, joints: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Axes (n, 3), their common point (3,), and the board's place at zero as rotation vector and position (6,)."""
    return unit(guess[: 3 * joints].reshape(joints, 3)), guess[3 * joints : 3 * joints + 3], guess[3 * joints + 3 :][:6]


def _turned(axes: FloatArray, position_rad: Sequence[float]) -> FloatArray:
    rotation = np.eye(3)
    for axis, angle in zip(axes, position_rad, strict=True):
        rotation = rotation @ axis_rotation(axis, angle)
    return rotation


def _missed(guess: FloatArray, joints: int, sightings: Sequence[Sighting], lens: Lens) -> FloatArray:
    """Pixels between the corners seen and those expected, all in one row."""
    axes, centre, place = _parts(guess, joints)
    free = guess[3 * joints + 9 :]
    through = Lens.of(free, lens.width, lens.height) if len(free) else lens
    lying = Rotation.from_rotvec(place[:3]).as_matrix()
    parts = []
    for sighting in sightings:
        at_zero = sighting.corner @ lying.T + place[3:]
        at = centre + (at_zero - centre) @ _turned(axes, sighting.position_rad).T
        parts.append(through.project(at) - sighting.pixel)
    return np.concatenate(parts).ravel()


def _start(sightings: Sequence[Sighting], lens: Lens) -> FloatArray:
    """A first guess from the board's place in each picture alone. Raises BadInput."""
    poses = [_pose(sighting, lens) for sighting in sightings]
    angles = np.array([sighting.position_rad for sighting in sightings])
    away = angles - angles[0]
    axes: list[FloatArray] = []
    for joint in range(angles.shape[1]):
        others = np.delete(away, joint, axis=1)
        moved = np.flatnonzero((np.abs(others) < STILL_RAD).all(axis=1))
        distinct = np.unique(np.round(away[moved, joint], 3))
        if len(distinct) < FEWEST_ANGLES or np.ptp(distinct) < WIDEST_RAD:
            raise BadInput(
                f"joint {joint + 1} is seen at {len(distinct)} angles over {np.degrees(np.ptp(distinct)):.0f} deg with "
                f"the others at rest: at least {FEWEST_ANGLES} over {np.degrees(WIDEST_RAD):.0f} deg are needed; turn "
                "it further, or look at the board less steeply"
            )
        axes.append(_axis(joint, moved, away, angles[0], axes, poses))
    turned = [_turned(np.array(axes), position) for position in angles]
    rows = np.concatenate([np.concatenate([np.eye(3) - turn, turn], axis=1) for turn in turned])
    at = np.concatenate([position for _, position in poses])
    found = np.linalg.lstsq(rows, at, rcond=1e-6)[0]
    lying = Rotation.from_matrix(turned[0].T @ poses[0][0]).as_rotvec()
    return np.concatenate([np.ravel(axes), found[:3], lying, found[3:]])


def _axis(
    joint: int,
    moved: Array,
    away: FloatArray,
    rest: FloatArray,
    before: Sequence[FloatArray],
    poses: Sequence[tuple[FloatArray, FloatArray]],
) -> FloatArray:
    """(3,) a joint's axis at zero, from pictures that differ from the first one in its angle only."""
    total = np.zeros(3)
    for index in moved:
        angle = (float(away[index, joint]) + np.pi) % (2.0 * np.pi) - np.pi
        if abs(angle) < FURTHEST_RAD:
            turn = poses[index][0] @ poses[0][0].T
            total += np.sign(angle) * np.asarray(Rotation.from_matrix(turn).as_rotvec())
    outer = _turned(np.array(before).reshape(-1, 3), rest[:joint].tolist())
    return unit(outer.T @ total)


def _pose(sighting: Sighting, lens: Lens) -> tuple[FloatArray, FloatArray]:
    """The board in the camera's frame: rotation (3, 3) and position (3,)."""
    found, turn, at = cv2.solvePnP(sighting.corner, sighting.pixel, lens.matrix(), lens.distortion())
    if not found:
        raise BadInput("the board's place cannot be worked out from one of the pictures: leave that picture out")
    return np.asarray(Rotation.from_rotvec(np.ravel(turn)).as_matrix()), np.asarray(np.ravel(at), np.float64)


def _up_and_centre(guess: FloatArray, joints: int, height_m: float) -> tuple[FloatArray, FloatArray]:
    """The last axis on the board's printed side (3,), and the objects' centre (3,), in the camera's frame."""
    axes, centre, place = _parts(guess, joints)
    normal = np.asarray(Rotation.from_rotvec(place[:3]).as_matrix())[:, 2]
    if normal @ place[3:] > 0.0:  # the printed side faces the camera
        normal = -normal
    up = axes[-1] if axes[-1] @ normal > 0.0 else -axes[-1]
    if joints == 1:  # where along its axis is not seen
        centre = centre + up * (normal @ (place[3:] - centre)) / (normal @ up)
    return up, centre + height_m * up


def _elevation(guess: FloatArray, joints: int, height_m: float) -> float:
    up, centre = _up_and_centre(guess, joints, height_m)
    return float(np.arcsin(np.clip(-unit(centre) @ up, -1.0, 1.0)))


def _elevation_slope(guess: FloatArray, joints: int, height_m: float, which: int) -> float:
    step = np.zeros(len(guess))
    step[which] = 1e-6 * max(1.0, abs(float(guess[which])))
    ends = [_elevation(guess + sign * step, joints, height_m) for sign in (1.0, -1.0)]
    return (ends[0] - ends[1]) / (2.0 * float(step[which]))
