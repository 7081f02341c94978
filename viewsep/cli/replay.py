"""`viewsep replay`."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from viewsep.cli.console import people, print_json, results
from viewsep.errors import BadInput
from viewsep.models.library import load_library
from viewsep.recordings.reader import read_recording
from viewsep.recordings.replay import FEATURE_TOLERANCE, FLOAT_TOLERANCE, restore, use_models, verify, verify_frames


def replay(
    recording: Annotated[Path, typer.Argument(help="Recording (MCAP).", metavar="FILE", show_default=False)],
    verify_decisions: Annotated[
        bool, typer.Option("--verify", help="Compare commands, estimates and result byte for byte.")
    ] = False,
    from_frames: Annotated[
        bool, typer.Option("--from-frames", help="Recompute the percepts from the pictures and compare them.")
    ] = False,
    models: Annotated[
        Path | None, typer.Option(help="Check that this library is what the recording was made with.")
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the findings as JSON.")] = False,
) -> None:
    """Feed a recording's events to the real engine again. Exit code 1 when it does not repeat what was recorded.

    Examples:

        viewsep replay run.mcap --verify

        viewsep replay run.mcap --verify --from-frames --json
    """
    if not (verify_decisions or from_frames or models):
        raise BadInput("nothing to do: give --verify, --from-frames or --models LIBRARY")
    say = people if json else results
    content = read_recording(recording)
    findings: dict[str, Any] = {"recording": str(recording)}
    if models:
        _, recorded = restore(content)
        use_models(content, load_library(models, [model.name for model in recorded]))
        findings["models"] = "same"
    if verify_decisions:
        decisions = verify(content)
        findings["decisions"] = asdict(decisions)
        kind = "byte for byte" if decisions.exact else f"with floats within {FLOAT_TOLERANCE:g} (another build)"
        say.print(f"verified: {decisions.outputs} outputs of {decisions.events} events repeated {kind}")
    if from_frames:
        frames = verify_frames(content)
        findings["frames"] = asdict(frames) | {"tolerance": FEATURE_TOLERANCE}
        say.print(
            f"frames: {frames.percepts} percepts recomputed, least similarity {frames.similarity_min:.3f} "
            f"(tolerance {FEATURE_TOLERANCE})"
        )
    if json:
        print_json(findings)
