"""What ROBOTIS' e-manual says of each model's registers: access, factory values, ranges."""

from __future__ import annotations

from types import MappingProxyType

from viewsep.drivers.dynamixel.control_table import model_number
from viewsep.errors import RigError

BAUD_RATES = (9600, 57600, 115200, 1_000_000, 2_000_000, 3_000_000, 4_000_000, 4_500_000)
"""By the code in the register Baud Rate."""

LIVE = (
    "Realtime Tick",
    "Moving",
    "Moving Status",
    "Present PWM",
    "Present Load",
    "Present Current",
    "Present Velocity",
    "Present Position",
    "Velocity Trajectory",
    "Position Trajectory",
    "Present Input Voltage",
    "Present Temperature",
)
READ_ONLY = frozenset(
    {*LIVE, "Model Number", "Model Information", "Firmware Version", "Registered Instruction", "Hardware Error Status"}
)
GOALS = frozenset({"Goal PWM", "Goal Current", "Goal Velocity", "Goal Position"})
FACTORY = {  # the whole series; what is not here is 0
    "ID": 1,
    "Baud Rate": 1,
    "Return Delay Time": 250,
    "Operating Mode": 3,
    "Secondary(Shadow) ID": 255,
    "Protocol Type": 2,
    "Moving Threshold": 10,
    "PWM Limit": 885,
    "Max Position Limit": 4095,
    "Shutdown": 0b110100,
    "Status Return Level": 2,
    "Velocity P Gain": 100,
}
RANGES = {
    "ID": (0, 252),
    "Baud Rate": (0, 7),
    "Return Delay Time": (0, 254),
    "Protocol Type": (2, 2),  # an emulated servo knows no other
    "Homing Offset": (-1_044_479, 1_044_479),
    "Moving Threshold": (0, 1023),
    "Temperature Limit": (0, 100),
    "PWM Limit": (0, 885),
    "Velocity Limit": (0, 1023),
    "Max Position Limit": (0, 4095),
    "Min Position Limit": (0, 4095),
    "Torque Enable": (0, 1),
    "LED": (0, 1),
    "Status Return Level": (0, 2),
    "Velocity I Gain": (0, 16383),
    "Velocity P Gain": (0, 16383),
    "Position D Gain": (0, 16383),
    "Position I Gain": (0, 16383),
    "Position P Gain": (0, 16383),
    "Feedforward 2nd Gain": (0, 16383),
    "Feedforward 1st Gain": (0, 16383),
    "Bus Watchdog": (0, 127),
    "Profile Acceleration": (0, 32767),
    "Profile Velocity": (0, 32767),
}
EXTENDED_GOAL = (-1_048_575, 1_048_575)
DRIVE_MODES = frozenset({0, 1, 4, 5})  # bit 0 reverse, bit 2 profile by time; dual joints are not emulated
POSITION, EXTENDED, CURRENT_BASED, VELOCITY, PWM, CURRENT = 3, 4, 5, 1, 16, 0


def _model(
    temperature: int, voltage: tuple[int, int], velocity: int, gains: tuple[int, int, int], **others: int
) -> MappingProxyType[str, int]:
    lowest, highest = voltage
    integral, differential, proportional = gains
    values = {"Temperature Limit": temperature, "Min Voltage Limit": lowest, "Max Voltage Limit": highest}
    values |= {"Velocity Limit": velocity, "Velocity I Gain": integral}
    values |= {"Position D Gain": differential, "Position P Gain": proportional}
    return MappingProxyType({**FACTORY, **values, **{key.replace("_", " "): value for key, value in others.items()}})


# temperature [degC], voltage [0.1 V], velocity limit [0.229 rev/min], gains: velocity I, position D, position P
MODELS = MappingProxyType(
    {
        "XL330-M077": _model(
            70, (35, 70), 1620, (400, 0, 400), Current_Limit=1750, Shutdown=53, Velocity_P_Gain=40, Position_I_Gain=400
        ),
        "XL330-M288": _model(70, (35, 70), 445, (1600, 0, 400), Current_Limit=1750, Shutdown=53, Velocity_P_Gain=180),
        "XC330-T288": _model(70, (55, 140), 320, (1200, 0, 900), Current_Limit=910, Velocity_P_Gain=40),
        "XL430-W250": _model(72, (60, 140), 265, (1000, 4000, 640)),
        "2XL430-W250": _model(72, (60, 140), 250, (1800, 2000, 640)),
        "XC430-W150": _model(80, (60, 160), 460, (1920, 0, 460), Moving_Threshold=20),
        "XC430-W240": _model(80, (60, 160), 306, (1920, 0, 700)),
        "XM430-W210": _model(80, (95, 160), 330, (1920, 0, 800), Current_Limit=1193),
        "XM430-W350": _model(80, (95, 160), 200, (1920, 0, 800), Current_Limit=1193),
        "XM540-W150": _model(80, (95, 160), 230, (1920, 0, 800), Current_Limit=2047),
        "XM540-W270": _model(80, (95, 160), 128, (1920, 0, 800), Current_Limit=2047),
    }
)


def factory_values(model: str) -> MappingProxyType[str, int]:
    """A model's values as it leaves the factory. Raises RigError for a model that is not emulated."""
    try:
        return MODELS[model.upper()]
    except KeyError:
        raise RigError(f"no emulated servo of model {model!r}: use one of {', '.join(MODELS)}") from None


def number_of(model: str) -> int:
    """The model number of an emulated model. Raises RigError."""
    factory_values(model)
    return model_number(model)


def value_range(name: str, factory: MappingProxyType[str, int]) -> tuple[int, int] | None:
    """The values a register takes; None: all that fit."""
    if name == "Current Limit":
        return 0, factory[name]
    if name in ("Max Voltage Limit", "Min Voltage Limit"):
        return min(factory["Min Voltage Limit"], 60), factory["Max Voltage Limit"]
    if name == "Velocity Limit":
        return 0, max(2047 if factory[name] > 1023 else 1023, factory[name])
    return RANGES.get(name)


def indirect_blocks(model: str) -> tuple[tuple[int, int], ...]:
    """First address of the pointers and of the data, for each block.

    The e-manual's: for the 330 servos, the `.model` files have the addresses of the larger ones.
    """
    return ((168, 208),) if "330" in model else ((168, 224), (578, 634))
