"""The models of a library folder, read again only when a file has changed."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path

from viewsep.errors import BadInput
from viewsep.models.aspect_graph import AspectGraph
from viewsep.models.library import SUFFIX, load
from viewsep.service.requests import Code, Refused


class Catalogue:
    """What a library folder holds. It need not exist yet. Thread-safe."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._lock = threading.Lock()
        self._known: dict[Path, tuple[tuple[int, int], AspectGraph | str]] = {}

    def digests(self) -> dict[str, str]:
        """Names and digests of the models that can be used."""
        return {model.name: model.digest for model in self.models()}

    def models(self) -> list[AspectGraph]:
        """The models that can be used."""
        return [entry for entry in self._read() if isinstance(entry, AspectGraph)]

    def faults(self) -> tuple[str, ...]:
        """What is wrong with the others, a sentence each."""
        return tuple(entry for entry in self._read() if isinstance(entry, str))

    def candidates(self, names: Sequence[str]) -> list[AspectGraph]:
        """The named models in that order, or all. Raises Refused: unknown or damaged models, fewer than two."""
        entries = self._read()
        models = {entry.name: entry for entry in entries if isinstance(entry, AspectGraph)}
        faults = [entry for entry in entries if isinstance(entry, str)]
        for name in names:
            if name not in models:
                raise Refused(
                    Code.UNKNOWN_MODEL,
                    next((fault for fault in faults if f"{name}{SUFFIX}" in fault), "")
                    or f"no model {name!r} in the library {self.folder}: it has {', '.join(models) or 'none'}",
                )
            if list(names).count(name) > 1:
                raise Refused(Code.BAD_REQUEST, f"candidate {name!r} is named twice: name each once")
        if not names and faults:
            raise Refused(Code.NO_MODELS, f"{faults[0]}; or name the candidates")
        chosen = [models[name] for name in names] if names else list(models.values())
        if len(chosen) < 2:
            raise Refused(
                Code.NO_MODELS,
                f"{len(chosen)} candidates: there is nothing to separate; the library {self.folder} has "
                f"{', '.join(models) or 'no models'}: learn the look-alikes or name more of them",
            )
        return chosen

    def _read(self) -> list[AspectGraph | str]:
        """Models, or what is wrong with them, in alphabetical order of the files."""
        with self._lock:
            known = {}
            for path in sorted(self.folder.glob(f"*{SUFFIX}")):
                try:
                    stat = path.stat()
                except OSError:
                    continue  # taken away between listing and looking
                state = (stat.st_mtime_ns, stat.st_size)
                before = self._known.get(path)
                known[path] = before if before and before[0] == state else (state, _load(path))
            self._known = known
            return [entry for _, entry in known.values()]


def _load(path: Path) -> AspectGraph | str:
    try:
        return load(path)
    except BadInput as error:
        return str(error)
