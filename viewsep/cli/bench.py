"""`viewsep bench`."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table

from viewsep.bench.speed import measure_speed
from viewsep.cli.bench_calibration import calibration
from viewsep.cli.bench_chain import chain
from viewsep.cli.bench_compensation import compensation
from viewsep.cli.bench_looks import looks
from viewsep.cli.bench_masks import masks
from viewsep.cli.bench_pose import pose
from viewsep.cli.bench_recording import recording
from viewsep.cli.bench_scale import scale
from viewsep.cli.bench_separation import separation
from viewsep.cli.bench_service import service
from viewsep.cli.bench_servos import servos
from viewsep.cli.bench_symmetries import symmetries
from viewsep.cli.console import MAX_SEED, print_json, results

app = typer.Typer(help="Measure the method: how often it is right, what it costs.", no_args_is_help=True)
app.command("recording")(recording)
app.command("separation")(separation)
app.command("calibration")(calibration)
app.command("chain")(chain)
app.command("compensation")(compensation)
app.command("looks")(looks)
app.command("masks")(masks)
app.command("pose")(pose)
app.command("scale")(scale)
app.command("service")(service)
app.command("servos")(servos)
app.command("symmetries")(symmetries)


@app.command()
def speed(
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the objects and tasks.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Time one engine step with two candidates, the descriptor of a view, and perception of a 640 x 480 frame.

    On one core; perception is finding the object before a captured background and cutting it out.

    Example:

        viewsep bench speed --json
    """
    figures = measure_speed(seed)
    if json:
        print_json(figures)
        return
    table = Table("what", "median ms", "p95 ms", "samples")
    for name, row in figures.items():
        table.add_row(name, f"{row['median_ms']:.2f}", f"{row['p95_ms']:.2f}", f"{row['samples']:.0f}")
    results.print(table)
