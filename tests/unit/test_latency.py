"""Latency and play from pictures of a turning object, both known."""

from __future__ import annotations

import numpy as np
import pytest

from viewsep.calibration.latency import AppearanceMap, Frames, ReadBacks, Timing, shown_angles, timing_of
from viewsep.calibration.play import followed, held_states
from viewsep.errors import BadInput
from viewsep.messages import Array, FloatArray, JointState

BOOT_NS = 987_654_321_000_000_000
STOPS = np.radians(np.arange(-40.0, 41.0, 4.0))
SPEEDS_DEG_S = (20.0, 45.0)


def seen(angle_rad: FloatArray) -> FloatArray:
    """(N,) angles of the object -> (N, 40) smooth features."""
    rng = np.random.default_rng(4)
    centres, widths = rng.uniform(-1.0, 1.0, 40), rng.uniform(0.1, 0.5, 40)
    return np.asarray(np.exp(-(((angle_rad[:, None] - centres) / widths) ** 2)))


def sweeps(
    latency_s: float, play_rad: float, noise: float, bad: float = 0.0
) -> tuple[AppearanceMap, Frames, ReadBacks]:
    """Up and down at two speeds, at 100 read-backs and 12 frames a second; the map from rest."""
    rng = np.random.default_rng(5)
    angle, times, ends = [float(np.radians(-60.0))], [0.0], [0.0]
    for speed in SPEEDS_DEG_S:
        for goal in (50.0, -60.0) * 2:
            way = np.radians(goal) - angle[-1]
            count = round(abs(way) / np.radians(speed) * 100.0)
            angle += (angle[-1] + way * np.arange(1, count + 1) / count).tolist()
            times += (times[-1] + 0.01 * np.arange(1, count + 1)).tolist()
            ends.append(times[-1])
    clock = np.array(times)
    held = followed(np.array(angle), play_rad)
    exposed = np.arange(0.7, clock[-1] - 0.2, 1.0 / 12.0)
    features = seen(np.interp(exposed, clock, held)) + noise * rng.normal(size=(len(exposed), 40))
    wrong = rng.random(len(exposed)) < bad
    features[wrong] = seen(rng.uniform(-0.7, 0.7, int(wrong.sum())))
    stamps = BOOT_NS + np.round((exposed + latency_s) * 1e9).astype(np.int64)
    rest = AppearanceMap(STOPS, seen(STOPS - 0.5 * play_rad))
    stretch = np.searchsorted(np.array(ends), exposed)
    return (
        rest,
        Frames(stamps, features, stretch),
        ReadBacks(BOOT_NS + np.round(clock * 1e9).astype(np.int64), np.array(angle)),
    )


def error_of(timing: Timing, latency_s: float, play_rad: float) -> tuple[float, float]:
    return abs(timing.latency_s.value - latency_s), float(np.degrees(abs(timing.play_rad.value - play_rad)))


@pytest.mark.parametrize(("latency_s", "play_deg"), [(0.08, 2.0), (0.0, 0.0), (0.15, 0.4), (-0.03, 5.0)])
def test_latency_and_play_are_found(latency_s: float, play_deg: float) -> None:
    timing = timing_of(*sweeps(latency_s, np.radians(play_deg), noise=0.01))
    late, play = error_of(timing, latency_s, np.radians(play_deg))
    assert late < 0.002
    assert play < 0.1
    assert timing.latency_s.margin < 0.005
    assert np.degrees(timing.play_rad.margin) < 0.3


def test_bad_frames_do_not_count() -> None:
    timing = timing_of(*sweeps(0.08, np.radians(2.0), noise=0.01, bad=0.2))
    late, play = error_of(timing, 0.08, np.radians(2.0))
    assert late < 0.003
    assert play < 0.15
    assert timing.rejected > 0.05 * timing.used


def test_intervals_grow_with_the_noise() -> None:
    quiet, loud = (timing_of(*sweeps(0.08, np.radians(2.0), noise)) for noise in (0.003, 0.1))
    assert loud.latency_s.margin > 3.0 * quiet.latency_s.margin
    assert loud.residual_rad > 3.0 * quiet.residual_rad


def test_angles_between_stops_are_read_off_the_map() -> None:
    angles = np.radians(np.linspace(-35.0, 35.0, 50))
    found, usable = shown_angles(AppearanceMap(STOPS, seen(STOPS)), seen(angles), angles + 0.05)
    assert usable.mean() > 0.8, "a few lie further from the map than is usual"
    assert np.degrees(np.abs(found - angles)).max() < 0.05


def test_too_little_is_said() -> None:
    rest, frames, encoder = sweeps(0.08, 0.0, 0.01)
    with pytest.raises(BadInput, match="5 stops are too few"):
        timing_of(AppearanceMap(rest.angle_rad[:5], rest.feature[:5]), frames, encoder)
    few = Frames(frames.stamp_ns[:20], frames.feature[:20], frames.stretch[:20])
    with pytest.raises(BadInput, match="turn an object with print all around"):
        timing_of(rest, few, encoder)


# ---- play ----


def test_the_object_hangs_behind_by_half_the_play() -> None:
    up_and_down = np.radians([0.0, 1.0, 5.0, 10.0, 9.5, 8.5, 4.0, 4.5])
    held = np.degrees(followed(up_and_down, np.radians(2.0)))
    assert held.tolist() == pytest.approx([0.0, 0.0, 4.0, 9.0, 9.0, 9.0, 5.0, 5.0])
    np.testing.assert_array_equal(followed(up_and_down, 0.0), up_and_down)


def test_read_backs_may_be_followed_in_parts() -> None:
    rng = np.random.default_rng(6)
    angles: Array = np.cumsum(rng.normal(0.0, 0.02, (60, 2)), axis=0)
    history = [JointState(k, (float(a), float(b)), (0.0, 0.0), True) for k, (a, b) in enumerate(angles)]
    play = (0.05, 0.0)
    whole = held_states(history, play)
    first = held_states(history[:25], play)
    assert whole == first + held_states(history[25:], play, first[-1])
    assert [state.position_rad[1] for state in whole] == angles[:, 1].tolist()
    assert held_states([], play) == ()
