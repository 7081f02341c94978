"""Recording a task: what the file carries besides the messages, and the thread that writes it."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from viewsep.config import Config
from viewsep.models import library
from viewsep.models.aspect_graph import AspectGraph
from viewsep.recordings.build import this_build
from viewsep.recordings.queue import QueuedListener
from viewsep.recordings.scene import Scene
from viewsep.recordings.writer import Attachment, Recorder

MODEL_MEDIA_TYPE = "application/x-viewsep-model"


def task_recorder(
    path: Path, config: Config, models: Sequence[AspectGraph], seed: int, truth: str, *, overwrite: bool = False
) -> Recorder:
    """A recorder for one task, with everything a replay needs. `truth` is empty where it is not known."""
    names = [model.name for model in models]
    metadata = {
        "config": {"json": config.model_dump_json()},
        "task": {"seed": str(seed), "truth": truth, "candidates": json.dumps(names)},
        "models": {model.name: model.digest for model in models},
        "build": this_build(),
    }
    attachments = [
        Attachment(f"{model.name}{library.SUFFIX}", MODEL_MEDIA_TYPE, library.to_bytes(model)) for model in models
    ]
    scene = Scene(config, models)
    return Recorder(path, metadata, attachments, settings=config.recording, companions=scene, overwrite=overwrite)


@contextmanager
def in_background(
    recorder: Recorder, config: Config, on_error: Callable[[Exception], None], *, patience_s: float = 0.0
) -> Iterator[QueuedListener]:
    """The recorder, opened and in a thread of its own; at the end the file is complete whatever has happened.

    `on_error` is called from that thread when recording cannot go on. A full queue is waited for `patience_s` at most.
    Raises BadInput as the recorder does.
    """
    with recorder:
        queued = QueuedListener(
            recorder,
            "viewsep recorder",
            on_error,
            most_bytes=round(config.recording.queue_mb * 1e6),
            patience_s=patience_s,
            idle=recorder.tick,
            idle_s=config.recording.sync_s,
        )
        try:
            yield queued
        finally:
            queued.close()
            recorder.lost = queued.lost
