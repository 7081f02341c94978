"""From hypothesis path to controlled path: the rotation object -> control, many paths at once (Fig. 4, eq. 2)."""

from __future__ import annotations

import numpy as np

from viewsep.messages import BoolArray, FloatArray

DEGENERATE = 1e-9
ARC_SINE = np.sin(np.radians(30.0))  # a node spacing and a bit


def arc_end(controlled: FloatArray) -> int:
    """Which hit of the controlled path (H, 3) is the end e_2 of Fig. 4: the last one that spans an arc with the start.

    Close to the start, and to the point opposite, it is the nodes' raster that decides where the arc goes, and with it
    psi. So the end is the last hit at least 30° away from both, or, while there is none, the one farthest away.
    """
    sine = np.linalg.norm(np.cross(controlled[0], controlled), axis=1)
    clear = np.flatnonzero(sine >= ARC_SINE)
    return int(clear[-1]) if len(clear) else int(np.argmax(sine))


def align_start_and_end(start: FloatArray, end: FloatArray, c_start: FloatArray, c_end: FloatArray) -> FloatArray:
    """Fig. 4: rotations (P, 3, 3) that carry starts (P, 3) onto `c_start` and put the ends onto the arc to `c_end`.

    The paper's three rotations (alpha about z and beta onto the start, then psi about it) end in the one rotation that
    carries start onto start and tangent onto tangent, so both frames are built and composed directly. Where a path
    has no tangent (its end is its start), psi is zero and the paper's alpha and beta remain.
    """
    tangent, has_arc = _tangents(start, end)
    c_tangent, c_has_arc = _tangents(c_start[None], c_end[None])
    rotation = _frames(np.broadcast_to(c_start, start.shape), c_tangent) @ _frames(start, tangent).swapaxes(-1, -2)
    open_arc = ~(has_arc & c_has_arc)
    if open_arc.any():
        rotation[open_arc] = meet_start(start[open_arc], c_start)
    return rotation


def meet_start(start: FloatArray, c_start: FloatArray) -> FloatArray:
    """(P, 3, 3): Rot(r_beta, beta) · Rot(z, alpha), which carries starts (P, 3) onto `c_start` along the meridian."""
    return _meridian_frames(c_start[None]) @ _meridian_frames(start).swapaxes(-1, -2)


def align_whole_path(correlation: FloatArray, fallback: FloatArray) -> FloatArray:
    """Wahba's problem: rotations (P, 3, 3) that maximise sum over hits of c · R u, given sum of c uᵀ (P, 3, 3).

    Solved by Davenport's q-method (the top eigenvector of a 4 x 4 matrix), all paths at once. Paths of fewer than two
    distinct directions leave the rotation open: they keep `fallback` (P, 3, 3).
    """
    b = correlation
    z = np.stack([b[:, 2, 1] - b[:, 1, 2], b[:, 0, 2] - b[:, 2, 0], b[:, 1, 0] - b[:, 0, 1]], axis=1)
    trace = np.trace(b, axis1=1, axis2=2)
    k = np.empty((len(b), 4, 4))
    k[:, :3, :3] = b + b.swapaxes(1, 2) - trace[:, None, None] * np.eye(3)
    k[:, :3, 3] = k[:, 3, :3] = z
    k[:, 3, 3] = trace
    values, vectors = np.linalg.eigh(k)
    rotation = _quaternion_matrices(vectors[:, :, 3])
    open_fit = values[:, 3] - values[:, 2] < DEGENERATE * np.abs(values[:, 3]) + DEGENERATE
    rotation[open_fit] = fallback[open_fit]
    return rotation


def _tangents(start: FloatArray, end: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Unit tangents (P, 3) at start towards end, and (P,) whether there is one."""
    tangent = end - np.einsum("pi,pi->p", start, end)[:, None] * start
    norm = np.sqrt(np.einsum("pi,pi->p", tangent, tangent))
    has_arc = norm > 1e-6
    return tangent / np.where(has_arc, norm, 1.0)[:, None], has_arc


def _frames(first: FloatArray, second: FloatArray) -> FloatArray:
    """(P, 3, 3) matrices with columns first, second, first x second."""
    frames = np.empty((len(first), 3, 3))
    frames[:, :, 0] = first
    frames[:, :, 1] = second
    (a, b, c), (d, e, f) = first.T, second.T
    frames[:, 0, 2] = b * f - c * e  # numpy's cross takes longer than all the rest here
    frames[:, 1, 2] = c * d - a * f
    frames[:, 2, 2] = a * e - b * d
    return frames


def _meridian_frames(direction: FloatArray) -> FloatArray:
    """(P, 3, 3) frames of a direction (P, 3) and the eastward tangent there (the y axis at a pole)."""
    horizontal = np.hypot(direction[:, 0], direction[:, 1])
    at_pole = horizontal < DEGENERATE
    east = np.stack([-direction[:, 1], direction[:, 0], np.zeros(len(direction))], axis=1)
    east /= np.where(at_pole, 1.0, horizontal)[:, None]
    east[at_pole] = (0.0, 1.0, 0.0)
    return _frames(direction, east)


def _quaternion_matrices(q: FloatArray) -> FloatArray:
    """(P, 4) unit quaternions x, y, z, w -> (P, 3, 3)."""
    x, y, z, w = q.T
    matrices = np.empty((len(q), 3, 3))
    matrices[:, 0, 0] = 1 - 2 * (y * y + z * z)
    matrices[:, 1, 1] = 1 - 2 * (x * x + z * z)
    matrices[:, 2, 2] = 1 - 2 * (x * x + y * y)
    matrices[:, 0, 1], matrices[:, 1, 0] = 2 * (x * y - z * w), 2 * (x * y + z * w)
    matrices[:, 0, 2], matrices[:, 2, 0] = 2 * (x * z + y * w), 2 * (x * z - y * w)
    matrices[:, 1, 2], matrices[:, 2, 1] = 2 * (y * z - x * w), 2 * (y * z + x * w)
    return matrices
