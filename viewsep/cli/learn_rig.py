"""`viewsep learn --rig`: from an object on the rig to a model."""

from __future__ import annotations

from pathlib import Path

from viewsep.calibration.compensation import compensated
from viewsep.capture.lesson import Lesson, learn_from_placements, photograph, shots_of
from viewsep.cli.console import people, print_json, progress_bar, results
from viewsep.cli.rig_interrupt import interrupt_noted, unless
from viewsep.config import Config
from viewsep.models import library
from viewsep.perception import RigPerception
from viewsep.perception.setup import finder_of
from viewsep.plugins import make_descriptor
from viewsep.rigs import rig_for


def learn_on_rig(lesson: Lesson, config: Config, output: Path, holding: str, seed: int, json: bool) -> None:
    """Photograph the object, learn its model, and say what was done."""
    held = rig_for(config, holding, seed + lesson.placement)
    rig = compensated(held.rig, config)
    perception = RigPerception(rig, make_descriptor(config.descriptor), finder_of(config))
    with interrupt_noted() as ended:
        with progress_bar() as bar:
            shots = shots_of(lesson, held.rig)
            task = bar.add_task("photographing", total=len(shots))

            def tick(problem: str) -> None:
                if problem:
                    people.print(f"skipped: {problem}", highlight=False)
                bar.advance(task)

            rig_config = config.rig.model_dump_json()
            stop = unless(ended, f"stopped; go on with the same command, the photos are in {lesson.photos}")
            skipped, photos = photograph(lesson, held.rig, perception, rig_config, tick, stop)
        model, placements = learn_from_placements(lesson, config)
        path = library.save(model, output)
    if json:
        print_json(
            {
                "name": model.name,
                "views": len(model.directions),
                "trials": 0 if model.trials is None else len(model.trials.directions),
                "photos": photos,
                "skipped": [{"number": one.number, "problem": one.problem} for one in skipped],
                "placements": placements,
                "rig": held.described,
                "photos_folder": str(lesson.folder),
                "file": str(path),
                "hash": model.digest,
            }
        )
        return
    results.print(
        f"learned [bold]{model.name}[/bold] from {placements} placement{'s' if placements > 1 else ''} on the "
        f"{held.described}: {len(model.directions)} views, {len(skipped)} of {len(shots)} photos skipped -> {path}\n"
        f"photos: {lesson.folder}, for a glance {lesson.photos / 'preview.jpg'}",
        soft_wrap=True,
    )
