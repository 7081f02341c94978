"""Control tables of the X series: registers by name, as ROBOTIS' `.model` files (shipped with dynamixel-sdk) list them.

The files give addresses and sizes. Signs and units are those of the e-manual, the same for the whole series.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from types import MappingProxyType

from viewsep.errors import RigError

X_SERIES = range(1000, 2000)  # model numbers
EEPROM_END = 64  # registers below are kept without power and written only while the torque is off
STEPS_PER_TURN = 4096
STEP_RAD = 2.0 * math.pi / STEPS_PER_TURN

SIGNED = frozenset(
    {
        "Homing Offset",
        "Bus Watchdog",
        "Goal PWM",
        "Goal Current",
        "Goal Velocity",
        "Goal Position",
        "Present PWM",
        "Present Current",
        "Present Load",
        "Present Velocity",
        "Present Position",
        "Velocity Trajectory",
        "Position Trajectory",
    }
)
VELOCITY_RAD_S = 0.229 * 2.0 * math.pi / 60.0
ACCELERATION_RAD_S2 = 214.577 * 2.0 * math.pi / 3600.0
SCALES: dict[str, tuple[float, str]] = {  # one count in SI units
    "Return Delay Time": (2e-6, "s"),
    "Homing Offset": (STEP_RAD, "rad"),
    "Moving Threshold": (VELOCITY_RAD_S, "rad/s"),
    "Temperature Limit": (1.0, "degC"),
    "Max Voltage Limit": (0.1, "V"),
    "Min Voltage Limit": (0.1, "V"),
    "PWM Limit": (0.00113, "of full"),
    "Velocity Limit": (VELOCITY_RAD_S, "rad/s"),
    "Max Position Limit": (STEP_RAD, "rad"),
    "Min Position Limit": (STEP_RAD, "rad"),
    "Bus Watchdog": (0.02, "s"),
    "Goal PWM": (0.00113, "of full"),
    "Goal Velocity": (VELOCITY_RAD_S, "rad/s"),
    "Profile Acceleration": (ACCELERATION_RAD_S2, "rad/s2"),
    "Profile Velocity": (VELOCITY_RAD_S, "rad/s"),
    "Goal Position": (STEP_RAD, "rad"),
    "Realtime Tick": (1e-3, "s"),
    "Present PWM": (0.00113, "of full"),
    "Present Load": (0.001, "of full"),
    "Present Velocity": (VELOCITY_RAD_S, "rad/s"),
    "Present Position": (STEP_RAD, "rad"),
    "Velocity Trajectory": (VELOCITY_RAD_S, "rad/s"),
    "Position Trajectory": (STEP_RAD, "rad"),
    "Present Input Voltage": (0.1, "V"),
    "Present Temperature": (1.0, "degC"),
}
CURRENTS = ("Current Limit", "Goal Current", "Present Current")
MILLIAMPERE_SERIES = ("XL330", "XC330")  # count 1 mA, all others 2.69 mA


@dataclass(frozen=True, slots=True)
class Register:
    """One entry of a control table. One count is `scale` of `unit`; `unit` is empty where counts are all there is."""

    name: str
    address: int
    size: int
    signed: bool
    scale: float = 1.0
    unit: str = ""

    @property
    def end(self) -> int:
        """The address after the last byte."""
        return self.address + self.size

    @property
    def in_eeprom(self) -> bool:
        """Whether the value outlives power and is locked while the torque is on."""
        return self.address < EEPROM_END

    @property
    def range(self) -> tuple[int, int]:
        """Smallest and largest count that fits."""
        bits = 8 * self.size
        return (-(1 << bits - 1), (1 << bits - 1) - 1) if self.signed else (0, (1 << bits) - 1)

    def decode(self, data: bytes) -> int:
        """Counts from exactly `size` bytes, least significant first."""
        if len(data) != self.size:
            raise ValueError(f"{self.name} has {self.size} bytes, not {len(data)}")
        return int.from_bytes(data, "little", signed=self.signed)

    def encode(self, counts: int) -> bytes:
        """`size` bytes from counts. Raises OverflowError when they do not fit."""
        return counts.to_bytes(self.size, "little", signed=self.signed)


@dataclass(frozen=True, slots=True)
class ControlTable:
    """The registers of one model, by name."""

    number: int
    model: str
    registers: MappingProxyType[str, Register]

    def __getitem__(self, name: str) -> Register:
        """Raises KeyError when the model has no such register."""
        return self.registers[name]

    def __contains__(self, name: str) -> bool:
        return name in self.registers


@lru_cache(maxsize=1)
def x_series() -> MappingProxyType[int, str]:
    """Names of the models of the X series by number, e.g. 1060: `XL430-W250`."""
    names = {}
    for number, file in (line.split("\t") for line in _lines("dynamixel.model")[1:]):
        if int(number) in X_SERIES:
            names[int(number)] = file.removesuffix(".model").upper().replace("_", "-")
    return MappingProxyType(names)


def model_name(number: int) -> str:
    """The model's name, or its number where it is not of the X series."""
    return x_series().get(number, f"model {number}")


def model_number(name: str) -> int:
    """The number of a model given by name. Raises KeyError."""
    return {known: number for number, known in x_series().items()}[name.upper()]


@lru_cache(maxsize=64)
def control_table(number: int, firmware: int = 0) -> ControlTable:
    """The control table of a model; some have another one from firmware 52 on. Raises RigError for other series."""
    if number not in x_series():
        raise RigError(
            f"servo model {number} is not of DYNAMIXEL's X series: use one of {', '.join(x_series().values())}"
        )
    model = x_series()[number]
    stem = model.lower().replace("-", "_")
    newer = f"{stem}_fw52.model"
    lines = _lines(newer if firmware >= 52 and (_FOLDER / newer).is_file() else f"{stem}.model")
    start = lines.index("[control table]") + 2
    entries = (line.split("\t") for line in lines[start:])
    registers = {name: _register(model, int(address), int(size), name) for address, size, name in entries}
    return ControlTable(number, model, MappingProxyType(registers))


def _register(model: str, address: int, size: int, name: str) -> Register:
    scale, unit = SCALES.get(name, (1.0, ""))
    if name in CURRENTS:
        scale, unit = (1e-3 if model.startswith(MILLIAMPERE_SERIES) else 2.69e-3), "A"
    return Register(name, address, size, name in SIGNED, scale, unit)


_FOLDER = files("dynamixel_easy_sdk") / "control_table"


def _lines(file: str) -> list[str]:
    return [line.strip() for line in (_FOLDER / file).read_text(encoding="utf-8").splitlines() if line.strip()]
