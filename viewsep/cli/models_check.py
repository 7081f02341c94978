"""`viewsep models check`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from rich.table import Column, Table

from viewsep.assembly import reachable_views
from viewsep.cli.console import people, print_json, progress_bar, results
from viewsep.config import Config, load_config
from viewsep.errors import BadInput
from viewsep.geometry import azimuth_elevation
from viewsep.library_check.alignment import Candidates
from viewsep.library_check.objects import Alone, alone, outdated, why_again
from viewsep.library_check.pairs import Pair, RigPoses, by_difficulty, pairs_of
from viewsep.library_check.words import object_in_words, pair_in_words, worth_saying
from viewsep.messages import FloatArray
from viewsep.models import library
from viewsep.plugins import make_descriptor

HARDER = 1  # exit code
IN_TABLE = 20


def check(
    folder: Annotated[Path, typer.Argument(help="Library folder.", metavar="LIBRARY", show_default=False)],
    config: Annotated[
        Path | None, typer.Option(help="TOML configuration; its rig and descriptor count here.", show_default=False)
    ] = None,
    fail_below: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=1.0,
            help="Exit with 1 if a look tells fewer bits about a pair, on average.",
            show_default=False,
        ),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Folder for pictures: confusion table, hardest pairs.", show_default=False)
    ] = None,
    every: Annotated[bool, typer.Option("--all", help="Show all pairs, not the 20 hardest only.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print everything as JSON.")] = False,
) -> None:
    """Tell which objects will be hard to tell apart, and from where, before anyone deploys them.

    Every two models are laid over each other in the pose in which they are most alike. Bits are what one look from
    anywhere tells on average about which of the two it is: 1 all, 0 nothing. A view tells two objects apart when a look
    from there shows the wrong one as the likelier in at most 5 % of the cases. With --config it also says in how many
    of the poses that an object may be held in the rig can show such a view.

    Columns: bits a look from anywhere and from the best view tells; views that tell the two apart; how far at most the
    next of those is; poses in which the rig shows one.

    Examples:

        viewsep models check library

        viewsep models check library --config rig.toml --plot pictures --fail-below 0.1
    """
    settings = load_config(config) if config else Config()
    descriptor = make_descriptor(settings.descriptor)
    known = library.load_library(folder)
    usable = [model for model in known if not why_again(model, descriptor)]
    old = [outdated(model, descriptor) for model in known if why_again(model, descriptor)]
    if not usable:
        raise BadInput(
            f"no model in {folder} was learned with the descriptor {descriptor.name!r}: learn the objects again, or "
            "give --config with theirs"
        )
    candidates = Candidates.of(usable)
    rig = RigPoses(reachable_views(settings.rig)) if config else None
    count = len(usable)
    with progress_bar() as progress:
        bar = progress.add_task("comparing", total=count * (count + 1) // 2)
        found: list[Pair] = []
        for pair in pairs_of(candidates, rig):
            found.append(pair)
            progress.advance(bar)
        each: list[Alone] = []
        for k in range(count):
            each.append(alone(candidates, k))
            progress.advance(bar)
    ranked, objects = by_difficulty(found), [*each, *old]
    if plot:
        _draw(ranked, candidates.names, plot)
    harder = [pair for pair in ranked if fail_below is not None and not pair.bits >= fail_below]
    if json:
        print_json({"objects": [_object(one) for one in objects], "pairs": [_pair(pair) for pair in ranked]})
    else:
        _show(ranked, objects, every)
    if harder:
        people.print(
            f"{len(harder)} of {len(ranked)} pairs are harder than {fail_below:g} bits a look, the hardest: "
            f"{harder[0].first} and {harder[0].second}",
            soft_wrap=True,
            highlight=False,
        )
        raise typer.Exit(HARDER)


def _draw(ranked: Sequence[Pair], names: Sequence[str], folder: Path) -> None:
    from viewsep.plots.confusion import draw_confusion, draw_hardest  # matplotlib is slow to import

    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"--plot {folder}: cannot make the folder: {error.strerror}; choose another") from error
    written = [draw_confusion(ranked, names, folder), *draw_hardest(ranked, folder)]
    for path in written:
        people.print(f"picture: {path}", soft_wrap=True, highlight=False)


def _show(ranked: Sequence[Pair], objects: Sequence[Alone], every: bool) -> None:
    names = [Column(name, overflow="fold") for name in ("object", "look-alike")]  # folded, but never cut
    numbers = ["bits", "best", "views %", "turn deg"]
    on_rig = any(pair.on_rig for pair in ranked)
    numbers += ["rig %"] if on_rig else []
    table = Table(*names, *(Column(number, no_wrap=True, justify="right") for number in numbers))
    shown = ranked if every else ranked[:IN_TABLE]
    for pair in shown:
        row = [
            pair.first,
            pair.second,
            _number(pair.bits),
            _number(pair.best_bits),
            _share(pair.telling),
            f"{np.degrees(pair.furthest_rad):.0f}" if np.isfinite(pair.furthest_rad) else "-",
        ]
        if on_rig:
            row.append(_share(pair.on_rig.told) if pair.on_rig else "-")
        table.add_row(*row)
    if ranked:
        results.print(table)
    if len(shown) < len(ranked):
        results.print(f"{len(ranked) - len(shown)} easier pairs are not shown (--all)", highlight=False)
    said = [*map(pair_in_words, worth_saying(ranked)), *filter(None, map(object_in_words, objects))]
    for sentence in said or ["Every pair is told apart by one look from nearly anywhere."]:
        results.print(sentence, soft_wrap=True, highlight=False)


def _pair(pair: Pair) -> dict[str, Any]:
    return {
        "first": pair.first,
        "second": pair.second,
        "bits": pair.bits,
        "best_bits": pair.best_bits,
        "telling_share": pair.telling,
        "furthest_deg": float(np.degrees(pair.furthest_rad)),
        "places": [
            {
                **_direction(place.centre),
                "radius_deg": float(np.degrees(place.radius_rad)),
                "share": place.share,
            }
            for place in pair.places
        ],
        "best_views": [_direction(view) for view in pair.best_views],
        "told_on_rig": pair.on_rig.told if pair.on_rig else None,
        "hopeless_on_rig": pair.on_rig.hopeless if pair.on_rig else None,
        "rotation": pair.alignment.rotation.tolist() if pair.alignment else None,
        "in_words": pair_in_words(pair),
    }


def _object(one: Alone) -> dict[str, Any]:
    turned = one.turned
    return {
        "name": one.name,
        "views": one.views,
        "trials": one.trials,
        "covered_share": one.covered,
        "learn_again": one.again,
        "expected_to_look_like": [{"name": name, "share": share} for name, share in one.lent],
        "most_alike_turned": turned
        and {
            "axis": list(turned.axis),
            "angle_deg": float(np.degrees(turned.angle_rad)),
            "bits": turned.bits,
            "telling_share": turned.telling,
            "alike": turned.alike,
        },
    }


def _direction(direction: FloatArray) -> dict[str, float]:
    azimuth, elevation = np.degrees(azimuth_elevation(direction)).tolist()
    return {"azimuth_deg": azimuth, "elevation_deg": elevation}


def _number(bits: float) -> str:
    return "-" if np.isnan(bits) else f"{bits:.2f}"


def _share(share: float) -> str:
    return (
        "-" if np.isnan(share) else f"{100.0 * share:.0f}" if share >= 0.1 or share == 0.0 else f"{100.0 * share:.1f}"
    )
