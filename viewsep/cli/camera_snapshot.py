"""`viewsep camera snapshot`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import cv2
import typer

from viewsep.cli.camera_options import ConfigFile, Device, OptionalFormat, Rate, Size, chosen, opened
from viewsep.cli.console import people, print_json
from viewsep.cli.service_options import Json
from viewsep.clock import MonotonicClock
from viewsep.drivers.v4l2.pictures import sharpness
from viewsep.errors import BadInput
from viewsep.files import write_whole

SUFFIXES = (".png", ".jpg", ".jpeg")
JPEG_QUALITY = 95


def snapshot(
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write: .png or .jpg.")] = Path("snapshot.png"),
    config: ConfigFile = None,
    device: Device = None,
    format: OptionalFormat = None,
    size: Size = None,
    rate_hz: Rate = None,
    timeout_s: Annotated[float, typer.Option("--timeout", min=0.1, max=600, help="Longest wait, seconds.")] = 5.0,
    force: Annotated[bool, typer.Option(help="Replace an existing file.")] = False,
    json: Json = False,
) -> None:
    """Take one picture and write it, with the settings of the configuration.

    Exit codes: 0 written, 1 the camera fails, 2 bad input.

    Examples:

        viewsep camera snapshot --config rig.toml -o tea.png

        viewsep camera snapshot --device /dev/video0 --size 1280x720 -o tea.jpg --force
    """
    if output.suffix.lower() not in SUFFIXES:
        raise BadInput(f"--output {output}: end its name with {' or '.join(SUFFIXES)}")
    if output.exists() and not force:
        raise BadInput(f"{output} exists: choose another name with -o, or --force to replace it")
    settings = chosen(config, device, format, size, rate_hz)
    with opened(settings) as camera:
        frame = camera.read(MonotonicClock().now_ns(), timeout_s)
        remarks = camera.remarks
    quality = [] if output.suffix.lower() == ".png" else [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    _, data = cv2.imencode(output.suffix.lower(), cv2.cvtColor(frame.image, cv2.COLOR_RGB2BGR), quality)
    write_whole(output, data.tobytes(), "picture")
    sharp = sharpness(frame.image)
    if json:
        height, width = frame.image.shape[:2]
        told = {"file": str(output), "width": width, "height": height, "stamp_ns": frame.stamp_ns}
        print_json({**told, "sharpness": sharp, "remarks": list(remarks)})
        return
    for remark in remarks:
        people.print(remark, soft_wrap=True, highlight=False)
    people.print(f"wrote {output}; sharpness {sharp:.1f}", soft_wrap=True, highlight=False)
