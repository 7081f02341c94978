"""What a session's recording carries besides the messages: configuration, seed, build and models."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from viewsep.config import Config
from viewsep.models import library
from viewsep.models.aspect_graph import AspectGraph
from viewsep.recordings.build import this_build
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
    return Recorder(path, metadata, attachments, overwrite=overwrite)
