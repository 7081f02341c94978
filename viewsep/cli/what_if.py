"""Recorded percepts through other methods: which ones, over which recordings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from viewsep.assembly import check_descriptor
from viewsep.cli.console import progress_bar
from viewsep.cli.plugin_option import onto, parse_plugin
from viewsep.cli.recording_files import Named, naming, recordings_in
from viewsep.config import Config, PluginConfig, parse_config
from viewsep.errors import BadInput, BadModel
from viewsep.models.aspect_graph import AspectGraph
from viewsep.models.library import load_library
from viewsep.plugins import make_descriptor
from viewsep.recordings.replay import restore
from viewsep.recordings.what_if import Course, recorded_course, what_if


@dataclass(frozen=True, slots=True)
class Method:
    """What to put in the place of what was recorded, None to keep it; `name` is how it was asked for."""

    name: str
    interpreter: PluginConfig | None
    planner: PluginConfig | None
    descriptor: PluginConfig | None

    def instead(self, recorded: Config) -> Config:
        """The recorded configuration with this method in it. Raises BadConfig."""
        table = recorded.model_dump()
        for kind in ("interpreter", "planner", "descriptor"):
            table[kind] = onto(getattr(recorded, kind), getattr(self, kind))
        return parse_config(table, f"the recorded configuration with {self.name}")


@dataclass(frozen=True, slots=True)
class Compared:
    """One recording: its name and files, the true object (empty where unknown), places where messages are missing, what
    was recorded, and the course of every method in their order."""

    name: str
    files: tuple[str, ...]
    truth: str
    gaps: int
    recorded: Course
    courses: tuple[Course, ...]


def methods_of(interpreters: Sequence[str], planners: Sequence[str], descriptor: str | None) -> list[Method]:
    """Every interpreter with every planner that the options name. Raises BadConfig, BadInput for one given twice."""
    for kind, given in (("interpreter", interpreters), ("planner", planners)):
        for text in given:
            if given.count(text) > 1:
                raise BadInput(f"--{kind} {text} is given twice: give it once")
    described = None if descriptor is None else parse_plugin("descriptor", descriptor)
    methods = []
    chosen: list[Sequence[str | None]] = [interpreters or [None], planners or [None]]
    for interpreter, planner in product(*chosen):
        words = [
            interpreter,
            None if planner is None else f"planner {planner}",
            None if descriptor is None else f"descriptor {descriptor}",
        ]
        methods.append(
            Method(
                ", ".join(word for word in words if word is not None),
                None if interpreter is None else parse_plugin("interpreter", interpreter),
                None if planner is None else parse_plugin("planner", planner),
                described,
            )
        )
    return methods


def compare(files: Sequence[Path], methods: Sequence[Method], library: Path | None) -> list[Compared]:
    """Every recording in `files` through every method, with the models of `library` where one is given.

    Raises BadInput and what becomes of it, naming the file.
    """
    return list(_compared(files, methods, library))


def _compared(files: Sequence[Path], methods: Sequence[Method], library: Path | None) -> Iterator[Compared]:
    with progress_bar() as progress:
        bar = progress.add_task("what if", total=len(files))
        for named in recordings_in(files):
            with naming(named.name):
                yield _compare(named, methods, library)
            progress.advance(bar, len(named.paths))


def _compare(named: Named, methods: Sequence[Method], library: Path | None) -> Compared:
    config, recorded_models = restore(named.recording)
    models = recorded_models
    if library is not None:
        models = load_library(library, [model.name for model in recorded_models])
    return Compared(
        name=named.name,
        files=tuple(map(str, named.paths)),
        truth=named.recording.metadata["task"].get("truth", ""),
        gaps=len(named.recording.gaps),
        recorded=recorded_course(named.recording),
        courses=tuple(_course(named, method, config, models, library) for method in methods),
    )


def _course(
    named: Named, method: Method, recorded: Config, models: Sequence[AspectGraph], library: Path | None
) -> Course:
    config = method.instead(recorded)
    descriptor = make_descriptor(config.descriptor)
    try:
        check_descriptor(models, descriptor)
    except BadModel as error:
        raise BadModel(_unfit(models, descriptor.name, descriptor.parameters, method, library)) from error
    return what_if(named.recording, config, models, None if method.descriptor is None else descriptor)


def _unfit(models: Sequence[AspectGraph], name: str, parameters: object, method: Method, library: Path | None) -> str:
    """What is wrong with models of another descriptor than the percepts', and what to do."""
    model = next(m for m in models if (m.descriptor, m.descriptor_parameters) != (name, parameters))
    learned = f"{model.descriptor} {model.descriptor_parameters}"
    if library is None:
        return (
            f"the recorded model {model.name!r} was learned with descriptor {learned}, not with {name} {parameters}: "
            "give --models LIBRARY with models that were (`viewsep learn --config`)"
        )
    if method.descriptor is None:
        return (
            f"model {model.name!r} in {library} was learned with descriptor {learned}, but the recorded percepts are "
            f"of {name} {parameters}: give --descriptor, so that percepts are made anew of the pictures"
        )
    return (
        f"model {model.name!r} in {library} was learned with descriptor {learned}, not with {name} {parameters} as "
        "--descriptor says: learn it again, or change --descriptor"
    )
