"""`viewsep bench masks`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from rich.table import Table

from viewsep.cli.console import MAX_SEED, print_json, progress_bar, results


def masks(
    objects: Annotated[Path | None, typer.Option(help="Folder of view sets to try as well.")] = None,
    runs: Annotated[int, typer.Option(min=1, max=1000, help="Objects on the stage, each in every scene.")] = 4,
    views: Annotated[int, typer.Option(min=4, max=3600, help="Looks at each, once around.")] = 36,
    capture_every_deg: Annotated[
        float, typer.Option(min=0.5, max=90.0, help="Between captures of the empty rig whose plate or gripper turns.")
    ] = 3.0,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of the first object and its scenes.")] = 0,
    json: Annotated[bool, typer.Option("--json", help="Print the figures and every look as JSON.")] = False,
) -> None:
    """Measure figure-ground segmentation: how well masks agree with the truth, and whether bad ones are noticed.

    On staged scenes with background, shadow, plate and gripper, on scenes in which something goes wrong half-way, and
    on photos: beside the masks they come with, and put on a desk. A mask is bad below an intersection over union of
    0.8, or where the object is not all in the picture.

    Examples:

        viewsep bench masks --runs 2 --views 24

        viewsep bench masks --objects photos --json
    """
    from viewsep.bench.masks import SCENES, masks_summary, photo_rows, staged_rows
    from viewsep.bench.tasks import objects_in

    folders = [Path(source) for source in objects_in(objects)] if objects else []
    with progress_bar() as bars:
        bar = bars.add_task("masks", total=runs * len(SCENES) + len(folders))
        rows = [row for folder in folders for row in photo_rows(folder, views, lambda: bars.advance(bar))]
        rows += staged_rows(range(seed, seed + runs), views, capture_every_deg, lambda: bars.advance(bar))
    figures = masks_summary(rows, seed)
    if json:
        about = {"seed": seed, "runs": runs, "views": views, "capture_every_deg": capture_every_deg}
        print_json({**about, "figures": figures, "looks": rows})
        return
    table = Table("scene", "looks", "IoU median (95 %)", "IoU 1 %, 5 %, 25 %", "bad", "let through", "good, refused")
    for name, row in figures.items():
        table.add_row(
            name,
            str(row["looks"]),
            _median(row),
            _low(row),
            str(row["bad"]),
            _through(row),
            f"{row['good']}, {row['good_refused']}",
        )
    results.print(table)


def _median(row: dict[str, Any]) -> str:
    if row["iou_quantiles"] is None:
        return "-"
    low, high = row["iou_median_bootstrap95"]
    return f"{row['iou_quantiles']['0.5']:.3f} ({low:.3f}-{high:.3f})"


def _low(row: dict[str, Any]) -> str:
    if row["iou_quantiles"] is None:
        return "-"
    return ", ".join(f"{row['iou_quantiles'][q]:.3f}" for q in ("0.01", "0.05", "0.25"))


def _through(row: dict[str, Any]) -> str:
    share = row["bad_let_through_of_accepted"]
    if share is None:
        return "0, nothing was accepted"
    low, high = row["bad_let_through_of_accepted_wilson95"]
    return f"{row['bad_let_through']}: {share:.2%} of accepted ({low:.2%}-{high:.2%})"
