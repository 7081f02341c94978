"""`viewsep rig emulate`."""

from __future__ import annotations

import math
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from viewsep.cli.console import people, print_json_line, results
from viewsep.cli.service_options import Json
from viewsep.errors import BadInput


class Preset(StrEnum):
    """Rigs there are emulated servos for."""

    TURNTABLE = "turntable"
    PAN_TILT = "pan_tilt"
    WRIST = "wrist"


def emulate(
    preset: Annotated[Preset, typer.Option(help="turntable: servo 1, pan_tilt: 1 and 2, wrist: 1 to 3.")],
    baud: Annotated[int, typer.Option(help="Baud rate of the servos.")] = 57600,
    backlash_deg: Annotated[float, typer.Option(min=0.0, max=20.0, help="Play of every gear.")] = 0.0,
    link: Annotated[
        Path | None, typer.Option(help="A symbolic link to the port, to have the same name every time.", metavar="PATH")
    ] = None,
    json: Json = False,
) -> None:
    """Emulate DYNAMIXEL servos behind a serial port of this computer, until Ctrl-C or SIGTERM. Linux only.

    Everything that speaks Protocol 2.0 can be tried on the printed port. No real servo is there: positions, loads and
    temperatures are simulated.

    Example:

        viewsep rig emulate --preset pan_tilt --link /tmp/servos
    """
    from viewsep.clock import MonotonicClock
    from viewsep.service.ending import Ending
    from viewsep.sim.dynamixel.models import BAUD_RATES
    from viewsep.sim.dynamixel.port import EmulatedPort
    from viewsep.sim.dynamixel.presets import emulated_bus

    if baud not in BAUD_RATES:
        raise BadInput(f"--baud {baud}: servos know {', '.join(map(str, BAUD_RATES))}")
    bus = emulated_bus(preset.value, MonotonicClock(), baud=baud, backlash_rad=math.radians(backlash_deg))
    ending = Ending()
    ending.on_signals()
    with EmulatedPort(bus, link) as port:
        servos = [
            {"id": s["ID"], "model": s.model, "firmware": s["Firmware Version"], "baud": s.baud} for s in bus.servos
        ]
        if json:
            print_json_line({"port": port.name, "servos": servos})
        else:
            results.print(port.name, soft_wrap=True, highlight=False)
            for servo in servos:
                results.print("emulated servo {id}: {model}, firmware {firmware}, {baud} baud".format(**servo))
            people.print("serving until Ctrl-C")
        ending.wait()
