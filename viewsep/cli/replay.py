"""`viewsep replay`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from viewsep.cli.console import people, print_json, results
from viewsep.cli.recording_files import Named, naming, recordings_in
from viewsep.cli.what_if import compare, methods_of
from viewsep.cli.what_if_tables import as_dict, tell
from viewsep.errors import BadInput
from viewsep.models.library import load_library
from viewsep.recordings.replay import FEATURE_TOLERANCE, FLOAT_TOLERANCE, restore, use_models, verify, verify_frames

PLUGIN = "NAME[:key=value,...]"


def replay(
    files: Annotated[
        list[Path],
        typer.Argument(help="Recordings (MCAP), the files of one in a row.", metavar="FILE...", show_default=False),
    ],
    verify_decisions: Annotated[
        bool, typer.Option("--verify", help="Compare commands, estimates and result byte for byte.")
    ] = False,
    from_frames: Annotated[
        bool, typer.Option("--from-frames", help="Recompute the percepts from the pictures and compare them.")
    ] = False,
    models: Annotated[
        Path | None,
        typer.Option(
            help="Check that this library is what the recordings were made with; beside one of the three options "
            "below: use its models, of the same names, instead of the recorded ones."
        ),
    ] = None,
    interpreter: Annotated[
        list[str] | None,
        typer.Option(metavar=PLUGIN, help="What if: another interpreter; several times to compare several."),
    ] = None,
    planner: Annotated[
        list[str] | None,
        typer.Option(metavar=PLUGIN, help="What if: another planner; `off` judges wherever the recorded path leads."),
    ] = None,
    descriptor: Annotated[
        str | None,
        typer.Option(metavar=PLUGIN, help="What if: percepts of another descriptor, made of the recorded pictures."),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> None:
    """Feed recorded events to the real engine again, or to another one to see what it would have made of them.

    `--verify`, `--from-frames` and `--models` alone check that the recordings repeat. `--interpreter`, `--planner` and
    `--descriptor` ask what if: the recorded percepts go through every interpreter with every planner that is named,
    and what they decide stands beside what was decided then. A plug-in that was used in the recording keeps its
    recorded options but for those that are given; the elements of a list are joined by `+`.

    Exit codes: 0 repeated or compared, 1 a recording is not repeated, 2 bad input.

    Examples:

        viewsep replay run.mcap --verify

        viewsep replay run.mcap run-2.mcap --verify --from-frames --json

        viewsep replay runs/*.mcap --interpreter path:alignment=wahba --interpreter path:rated_by=w0+w1

        viewsep replay runs/*.mcap --planner off --models library_learned_anew
    """
    if interpreter or planner or descriptor:
        if verify_decisions or from_frames:
            raise BadInput(
                "--verify and --from-frames check what was recorded, --interpreter, --planner and --descriptor try "
                "something else: give the one or the other"
            )
        methods = methods_of(interpreter or [], planner or [], descriptor)
        compared = compare(files, methods, models)
        if json:
            print_json(as_dict(compared, methods))
        else:
            tell(compared, methods)
        return
    if not (verify_decisions or from_frames or models):
        raise BadInput(
            "nothing to do: give --verify, --from-frames or --models LIBRARY to check, or --interpreter, --planner or "
            "--descriptor to try something else"
        )
    findings = [_check(named, verify_decisions, from_frames, models, json, files) for named in recordings_in(files)]
    if json:
        print_json(findings[0] if len(findings) == 1 else findings)


def _check(
    named: Named, decisions: bool, frames: bool, models: Path | None, json: bool, files: Sequence[Path]
) -> dict[str, Any]:
    """That the recording repeats, in every way that is asked for; what was found, for JSON."""
    say = people if json else results
    findings: dict[str, Any] = {"recording": named.name}
    if len(files) > len(named.paths):
        say.print(f"{named.name}:", soft_wrap=True, highlight=False, markup=False)
    with naming(named.name):
        if models:
            _, recorded = restore(named.recording)
            use_models(named.recording, load_library(models, [model.name for model in recorded]))
            findings["models"] = "same"
        if decisions:
            found = verify(named.recording)
            findings["decisions"] = asdict(found)
            kind = "byte for byte" if found.exact else f"with floats within {FLOAT_TOLERANCE:g} (another build)"
            say.print(f"verified: {found.outputs} outputs of {found.events} events repeated {kind}")
        if frames:
            checked = verify_frames(named.recording)
            findings["frames"] = asdict(checked) | {"tolerance": FEATURE_TOLERANCE}
            say.print(
                f"frames: {checked.percepts} percepts recomputed, least similarity {checked.similarity_min:.3f} "
                f"(tolerance {FEATURE_TOLERANCE})"
            )
    return findings
