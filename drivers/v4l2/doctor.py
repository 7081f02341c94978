"""Looks a camera over: what is right, what is wrong, what could be better, and what to do about it."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from viewsep.drivers.checks import Check, Verdict, check
from viewsep.drivers.v4l2.errors import SettingRefused
from viewsep.drivers.v4l2.exposures import Exposures
from viewsep.drivers.v4l2.listing import holders, stable_name
from viewsep.drivers.v4l2.node import Node
from viewsep.drivers.v4l2.settings import V4l2Settings
from viewsep.drivers.v4l2.stream import Exposure, NoFrame, Stream
from viewsep.drivers.v4l2.system import THIS_MACHINE, System
from viewsep.errors import RigError
from viewsep.interfaces import Clock

FRAMES = 30
RATE_SHARE = 0.9
LATE_MS = 150.0
AHEAD_MS = 1.0


def examine(settings: V4l2Settings, clock: Clock, system: System = THIS_MACHINE) -> Iterator[Check]:
    """Look at the device, then at its settings, then at what it delivers; ends at the first that nothing can follow."""
    try:
        with Node(settings.device, system) as node:
            yield from _device(node, settings, system)
    except RigError as error:
        yield Check("device", Verdict.BAD, settings.device, str(error))
        return
    try:
        stream = Stream(settings.device, settings, clock, system)
    except RigError as error:
        name = "settings" if isinstance(error, SettingRefused) else "opening"
        yield Check(name, Verdict.BAD, f"{settings.format} {settings.width} x {settings.height}", str(error))
        return
    try:
        yield from _settings(stream, settings)
        yield from _frames(stream, settings)
    except RigError as error:
        yield Check("pictures", Verdict.BAD, "none", str(error))
    finally:
        stream.close()


def _device(node: Node, settings: V4l2Settings, system: System) -> Iterator[Check]:
    capability = node.capability()
    yield Check("device", Verdict.GOOD, f"{settings.device} → {Path(settings.device).resolve()}")
    yield Check("camera", Verdict.GOOD, f"{capability.card}, driver {capability.driver}, at {capability.bus}")
    stable = stable_name(settings.device, system)
    remedy = f"use {stable}, which stays when it is plugged anew"
    good = stable == settings.device or Path(settings.device).is_symlink()
    yield check("name", good, settings.device, remedy, Verdict.BETTER)
    who = holders(settings.device, system)
    remedy = "end it if it takes pictures, too: only one process can"
    yield check("alone", not who, f"also open in {' and '.join(who)}" if who else "yes", remedy, Verdict.BETTER)
    yield Check("formats", Verdict.GOOD, _shortened(node.formats()))


def _settings(stream: Stream, settings: V4l2Settings) -> Iterator[Check]:
    said = f"{settings.format} {settings.width} x {settings.height}, {settings.rate_hz} per second"
    yield Check("settings", Verdict.GOOD, f"{said}: read back")
    for remark in stream.remarks:
        yield Check("left to the camera", Verdict.BETTER, remark, "give it a value in [v4l2], so that colours compare")
    stream.check_settings()


def _frames(stream: Stream, settings: V4l2Settings) -> Iterator[Check]:
    frames = [stream.first()]
    silent = 0
    while len(frames) < FRAMES and silent < 3:
        try:
            frames.append(stream.grab())
        except NoFrame:
            silent += 1
    if silent == 3:
        yield Check("pictures", Verdict.BAD, f"{len(frames)} of {FRAMES}, then none", "check its cable")
        return
    kept, remedy = _kept(stream), "end what else sets them, or leave them out"
    yield check("controls", kept, "as they were set" if kept else "changed meanwhile", remedy)
    yield from _timing(frames, settings)


def _timing(frames: list[Exposure], settings: V4l2Settings) -> Iterator[Check]:
    stamps_ns = [frame.stamp_ns for frame in frames]
    intervals_ns = np.diff(stamps_ns)
    rising = bool((intervals_ns > 0).all())
    yield check("stamps", rising, "monotonic clock, rising" if rising else "go back", "set v4l2.stamps = 'arrival'")
    exposures = Exposures(settings.period_ns)
    for before, after in pairwise(stamps_ns):
        exposures.learn(after - before)
    rate_hz = 1e9 / exposures.period_ns
    remedy = "shorten the exposure or give more light; another format or size may be faster over USB"
    good = rate_hz >= RATE_SHARE * settings.rate_hz
    yield check("rate", good, f"{rate_hz:.1f} of {settings.rate_hz} per second", remedy, Verdict.BETTER)
    numbers = [exposures.number(stamp_ns) for stamp_ns in stamps_ns]
    lost = numbers[-1] - numbers[0] - len(frames) + 1
    remedy = "use another USB socket or a smaller picture; is the machine busy?"
    yield check("drops", lost == 0, f"{lost} of {numbers[-1] + 1}", remedy, Verdict.BETTER)
    damaged = [frame.fault for frame in frames if frame.raw is None]
    said = f"{len(damaged)} of {len(frames)}" + (f" ({damaged[0]})" if damaged else "")
    yield check("damaged", not damaged, said, "use another cable or USB socket", Verdict.BETTER)
    late_ms = np.array([frame.arrival_ns - frame.stamp_ns for frame in frames]) * 1e-6
    middle, worst = float(np.median(late_ms)), float(late_ms.max())
    said = f"{middle:.1f} ms after the stamp, at worst {worst:.1f}"
    if middle < -AHEAD_MS:
        remedy = "the moment of arrival is taken instead: turn slowly"
        yield Check("arrival", Verdict.BETTER, f"{-middle:.1f} ms before the stamp", remedy)
        return
    if settings.stamps == "arrival":
        said = "not known: frames are stamped when they arrive"
    yield check("arrival", middle <= LATE_MS, said, "a smaller picture arrives sooner", Verdict.BETTER)


def _kept(stream: Stream) -> bool:
    try:
        stream.check_settings()
    except SettingRefused:
        return False
    return True


def _shortened(formats: tuple[str, ...], most: int = 8) -> str:
    return ", ".join(formats[:most]) + (f" and {len(formats) - most} more" if len(formats) > most else "")
