"""What a service that ended badly left of its recordings is saved when the next one starts."""

from __future__ import annotations

import logging
from pathlib import Path

from viewsep.errors import ViewsepError
from viewsep.recordings.recovery import recover, told, unfinished

log = logging.getLogger("viewsep.service.engine")


def save_leftovers(folder: Path) -> None:
    """Recover every `.part` in the folder that nobody is writing; the log says what was saved and lost."""
    for part in unfinished(folder):
        try:
            for line in told(recover(part), part):
                log.warning("unfinished recording %s", line)
        except (ViewsepError, OSError) as error:
            log.warning("an unfinished recording cannot be recovered: %s", error)
