"""`viewsep rig init`."""

from __future__ import annotations

import tomllib
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import numpy as np
import tomlkit
import typer

from viewsep.camera_config import StageConfig
from viewsep.cli.console import people
from viewsep.cli.rig_emulate import Preset
from viewsep.config import parse_config
from viewsep.drivers.dynamixel.bus import BAUDS
from viewsep.errors import BadInput
from viewsep.files import write_whole
from viewsep.framing import FRAME_FILL
from viewsep.kinematics import preset as rig_preset
from viewsep.servo_rig import EMULATED

HEAD = """\
# A {preset} on DYNAMIXEL servos; docs/hardware.md says how to set it up. Angles are in degrees, times in seconds.
# Every other key has the default shown in docs/config/gimbal.toml.

[rig]
backend = "dynamixel"
preset = "{preset}"            # its joints and their limits; another rig: [[rig.joints]] as in docs/config/wrist.toml
camera_elevation_deg = {elevation:g}   # how high the camera looks down on the object

[dynamixel]
port = "{port}"{remark}
baud = {baud}                   # of all servos; 1000000 is better for three of them
state_hz = 100.0               # how often the servos are read, as far as the baud allows
retries = 3                    # of an instruction that is not answered
watchdog_s = 0.5               # a servo that hears nothing for this long stops by itself; 0: never
when_stopped = "hold"          # or "release": let the joints go
settle_within_deg = 0.5        # a joint this close to its set-point has arrived
lost_s = 0.5                   # a servo that is silent for this long is lost
emulated_speed = 1.0           # seconds of emulated servos per second
"""
SERVO = """
[[dynamixel.servos]]           # {limits}
joint = "{joint}"
id = {number}
model = ""                     # e.g. "XL430-W250"; empty: any
mode = "{mode}"{space}# "position": within one turn of the servo, "extended": 256 turns each way
zero_counts = 2048             # position of the servo when the joint is at zero
direction = 1                  # -1: the joint turns the other way
gear_ratio = 1.0               # turns of the servo for one turn of the joint
acceleration_deg_s2 = 300.0
# effort_limit = 0.5           # share of full load, or A where the model measures current
# temperature_limit_c = 60.0   # left out: the servo's own limits
# min_voltage_v = 10.0
# max_voltage_v = 13.0
"""
CAMERA = """
[camera]
source = "{source}"{remark}
# latency_s = 0.0              # how late its stamps are: `viewsep rig calibrate camera`

[perception]                   # finds the object in the pictures; docs/perception.md
method = "background"          # or "plain": before a backdrop of one colour
background = {background} # `viewsep rig background` writes it
object_radius_px = {radius:<12}# from the middle of the largest object to its furthest corner, in the picture;
                               # 0: the largest seen so far
"""
STANDING = """
[sim]
placed = "standing"            # objects stand upright on the plate, at an unknown angle
"""
POSE = """
[interpreter.options]
rotations = 40000              # of the grid on which the pose is sought: prints that are seen closely change fast
"""
UPRIGHT = """\
upright_within_deg = 15.0      # objects stand on the plate as they were learned; 180: anyhow, as after --placement 2
"""
V4L2 = """
[v4l2]                         # docs/camera.md; what is left out, the camera changes by itself, and colours with it
device = "{device}"
format = "MJPG"
width_px = 640
height_px = 480
rate_hz = 30
# exposure_ms = 10.0           # `viewsep camera doctor --config FILE` says what is left to the camera
# white_balance_k = 4600
# gain = 0
# focus = 30                   # `viewsep camera focus --config FILE`
"""


class Camera(StrEnum):
    """What looks at the object."""

    SIMULATED = "simulated"
    STAGED = "staged"
    V4L2 = "v4l2"


def init(
    preset: Annotated[Preset, typer.Option(help="Which joints there are.")],
    port: Annotated[str, typer.Option(help="Serial port of the servos.", metavar="PORT")] = EMULATED,
    baud: Annotated[int, typer.Option(help="Baud of the servos.")] = 57600,
    camera: Annotated[
        Camera,
        typer.Option(help="v4l2: a real one; simulated with masks, or staged: with desk, plate and shadow instead."),
    ] = Camera.SIMULATED,
    device: Annotated[
        str | None,
        typer.Option(metavar="PATH", help="--camera v4l2: its name, see `viewsep camera list`.", show_default=False),
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write.")] = Path("rig.toml"),
    force: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
) -> None:
    """Write a commented configuration for a rig of servos.

    Without --port the servos are emulated, without --camera it is simulated: everything can be tried without hardware.

    Examples:

        viewsep rig init --preset turntable --port /dev/serial/by-id/usb-FTDI_USB-RS485

        viewsep rig init --preset turntable --port /dev/ttyUSB0 --camera v4l2 --device /dev/video0

        viewsep rig init --preset turntable --camera staged

        viewsep rig init --preset pan_tilt -o rig.toml
    """
    if baud not in BAUDS:
        raise BadInput(f"--baud {baud}: servos know {', '.join(str(known) for known in sorted(BAUDS))}")
    if not port.isprintable() or set(port) & set('"\\') or not port:
        raise BadInput(f"--port {port!r} is no name of a port: `viewsep rig ports` lists them")
    if (device is None) == (camera is Camera.V4L2):
        raise BadInput(
            "--camera v4l2 needs --device PATH, the camera's name: `viewsep camera list`"
            if device is None
            else f"--device {device!r} goes with --camera v4l2"
        )
    if device is not None and (not device.isprintable() or set(device) & set('"\\') or not device):
        raise BadInput(f"--device {device!r} is no name of a camera: `viewsep camera list` lists them")
    if output.exists() and not force:
        raise BadInput(f"{output} exists: choose another name with -o, or --force to replace it")
    text = configuration(preset.value, port, baud) + camera_tables(camera, preset.value, device or "", output)
    parse_config(tomllib.loads(text), str(output))
    write_whole(output, text.encode(), "configuration")
    next_step = f"viewsep rig doctor --config {output}"
    if port == EMULATED:
        simulated = camera is Camera.SIMULATED
        next_step = f"viewsep separate --config {output} ..." if simulated else f"viewsep rig background -c {output}"
    people.print(f"wrote {output}; next: {next_step}", soft_wrap=True, highlight=False)


def configuration(preset: str, port: str, baud: int) -> str:
    """The file's text."""
    geometry = rig_preset(preset)
    elevation = float(np.degrees(np.arcsin(geometry.camera_direction[2])))
    remark = "              # no hardware; `viewsep rig ports` lists the real ones" if port == EMULATED else ""
    text = HEAD.format(preset=preset, elevation=round(elevation, 6), port=port, remark=remark, baud=baud)
    for number, joint in enumerate(geometry.limits, 1):
        free = not np.isfinite(joint.upper_rad)
        limits = (
            "turns freely" if free else f"{np.degrees(joint.lower_rad):g} to {np.degrees(joint.upper_rad):g} degrees"
        )
        mode = "extended" if free else "position"
        text += SERVO.format(joint=joint.name, number=number, mode=mode, space=" " * 13, limits=limits)
    return text


def camera_tables(camera: Camera, preset: str, device: str, output: Path) -> str:
    """What the file says of the camera; nothing where it is the one of the defaults."""
    if camera is Camera.SIMULATED:
        return ""
    staged = camera is Camera.STAGED
    text = CAMERA.format(
        source=camera.value,
        remark='              # simulated, with desk, plate and shadow; a real one: "v4l2", with [v4l2]'
        if staged
        else "",
        background=tomlkit.string(str(output.with_name(f"{output.stem}_background.npz"))).as_string(),
        radius=round(0.5 * FRAME_FILL * StageConfig().object_px) if staged else 0,
    )
    turntable = preset == Preset.TURNTABLE.value
    text += (STANDING if turntable and staged else "") + POSE + (UPRIGHT if turntable else "")
    return text if staged else text + V4L2.format(device=device)
