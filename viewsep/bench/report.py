"""The result of an experiment, as it is written to a JSON file, printed and drawn."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from viewsep import __version__
from viewsep.bench.journal import Row
from viewsep.bench.reliability import calibration_summary
from viewsep.bench.summary import mcnemar, summarise
from viewsep.files import write_whole


@dataclass(frozen=True, slots=True)
class Report:
    """All rows of an experiment of one `kind` (`separation`, `calibration` or `pose`), the main method's first.

    `about` says what was done: seed, objects, disturbances.
    """

    kind: str
    about: dict[str, Any]
    rows: list[Row]

    @property
    def methods(self) -> list[str]:
        """Names in the order they were asked for; the first one is the main method."""
        return list(dict.fromkeys(row["method"] for row in self.rows))

    def of(self, method: str) -> list[Row]:
        """The rows of one method in the order of the tasks."""
        return [row for row in self.rows if row["method"] == method]

    def summaries(self) -> dict[str, dict[str, Any]]:
        """The figures of every method."""
        figures = calibration_summary if self.kind == "calibration" else summarise
        return {method: figures(self.of(method)) for method in self.methods}

    def comparisons(self) -> list[dict[str, Any]]:
        """McNemar's test of the main method against each other one."""
        main, *others = self.methods
        return [{"first": main, "second": other} | mcnemar(self.of(main), self.of(other)) for other in others]

    def as_dict(self) -> dict[str, Any]:
        """For JSON. `summary` is that of the main method, and for poses one per method."""
        summaries = self.summaries()
        return {
            "kind": self.kind,
            "software": f"viewsep {__version__}",
            "about": self.about,
            "summary": summaries if self.kind == "pose" else summaries[self.methods[0]],
            "summaries": summaries,
            "comparisons": self.comparisons(),
            "tasks": [{key: value for key, value in row.items() if key != "course"} for row in self.rows],
        }

    def write(self, path: Path) -> None:
        """Write it as JSON, under a temporary name first. Raises BadInput where that is impossible."""
        write_whole(path, json.dumps(self.as_dict(), indent=1, allow_nan=False).encode(), "result")
