"""Exposure, white balance, gain and focus: set to fixed values, and read back, since colours are compared."""

from __future__ import annotations

from dataclasses import dataclass

from viewsep.drivers.v4l2.errors import SettingRefused
from viewsep.drivers.v4l2.node import INACTIVE, Control, Node
from viewsep.drivers.v4l2.settings import V4l2Settings

AUTO_WHITE_BALANCE, AUTOGAIN, GAIN, WHITE_BALANCE = 0x0098_090C, 0x0098_0912, 0x0098_0913, 0x0098_091A
EXPOSURE_AUTO, EXPOSURE, EXPOSURE_PRIORITY = 0x009A_0901, 0x009A_0902, 0x009A_0903
FOCUS, FOCUS_AUTO = 0x009A_090A, 0x009A_090C
MANUAL_EXPOSURE = 1
EXPOSURE_UNITS_PER_MS = 10


@dataclass(frozen=True, slots=True)
class Fixed:
    """One setting: its key, the control with its value, and what has to be off first (where the camera has it)."""

    key: str
    control: int
    value: int | None
    first: tuple[tuple[int, int], ...]


def fixed(settings: V4l2Settings) -> tuple[Fixed, ...]:
    """What the settings ask of the controls."""
    exposure = None if settings.exposure_ms is None else round(settings.exposure_ms * EXPOSURE_UNITS_PER_MS)
    return (
        Fixed("exposure_ms", EXPOSURE, exposure, ((EXPOSURE_AUTO, MANUAL_EXPOSURE), (EXPOSURE_PRIORITY, 0))),
        Fixed("white_balance_k", WHITE_BALANCE, settings.white_balance_k, ((AUTO_WHITE_BALANCE, 0),)),
        Fixed("gain", GAIN, settings.gain, ((AUTOGAIN, 0),)),
        Fixed("focus", FOCUS, settings.focus, ((FOCUS_AUTO, 0),)),
    )


def set_fixed(node: Node, settings: V4l2Settings) -> tuple[str, ...]:
    """Set every control that has a value and make sure that the camera took it; remarks about those without one.

    Raises SettingRefused naming control, wanted and got.
    """
    wanted = [(one, _checked(node, one, one.value)) for one in fixed(settings) if one.value is not None]
    remarks = [remark for one in fixed(settings) if one.value is None for remark in _left(node, one)]
    for one, steps in wanted:
        for control, value in steps:
            _set(node, one, control, value)
    return tuple(remarks)


def verify(node: Node, settings: V4l2Settings) -> None:
    """Read back again what was set. Raises SettingRefused."""
    for one in fixed(settings):
        if one.value is not None:
            for number, value in (*one.first, (one.control, one.value)):
                if (control := node.control(number)) is not None:
                    _expect(node, one, control, value)


def _checked(node: Node, one: Fixed, wanted: int) -> list[tuple[Control, int]]:
    """What has to be set to what, in order, if the camera can: nothing is set before all was looked at."""
    control = node.control(one.control)
    if control is None:
        raise SettingRefused(f"the camera {node.path} has no control for {one.key} = {wanted}: leave it out")
    automatic = [(node.control(number), value) for number, value in one.first]
    steps = [(found, value) for found, value in (*automatic, (control, wanted)) if found is not None]
    for found, value in steps:
        if not found.usable:
            raise SettingRefused(f"{_name(node, found)} cannot be set: leave {one.key} out")
        if not found.minimum <= value <= found.maximum:
            raise SettingRefused(
                f"{_name(node, found)} takes {found.minimum} to {found.maximum}, not {value}: correct {one.key}"
                + _units(one)
            )
    return steps


def _set(node: Node, one: Fixed, control: Control, value: int) -> None:
    try:
        node.set_value(control.id, value)
    except OSError as error:
        raise SettingRefused(
            f"{_name(node, control)} refused {value} ({error.strerror}): correct {one.key}, or leave it out"
        ) from error
    _expect(node, one, control, value)


def _expect(node: Node, one: Fixed, control: Control, value: int) -> None:
    try:
        got = node.value(control.id)
    except OSError as error:
        raise SettingRefused(f"{_name(node, control)} cannot be read back ({error.strerror})") from error
    if got != value:
        step = f" (it goes in steps of {control.step})" if control.step > 1 else ""
        raise SettingRefused(
            f"{_name(node, control)} is {got} instead of {value}{step}: set {one.key} to a value that it keeps"
            + _units(one)
        )


def _left(node: Node, one: Fixed) -> list[str]:
    control = node.control(one.control)
    if control is None:
        return []
    automatic = [
        (number, manual) for number, manual in one.first[:1] if (found := node.control(number)) and found.usable
    ]
    try:
        by_itself = any(node.value(number) != manual for number, manual in automatic)
        now = node.value(control.id)
    except OSError:
        return [f"{one.key} is not set, and {control.name!r} cannot be read"]
    if by_itself or control.flags & INACTIVE:
        return [f"{one.key} is not set: the camera changes {control.name!r} by itself, and colours with it"]
    return [f"{one.key} is not set: {control.name!r} stays at {now} until somebody changes it"]


def _units(one: Fixed) -> str:
    return f" (a unit is {1 / EXPOSURE_UNITS_PER_MS} ms)" if one.key == "exposure_ms" else ""


def _name(node: Node, control: Control) -> str:
    return f"control {control.name!r} of the camera {node.path}"
