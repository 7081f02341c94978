"""Descriptors, interpreters and planners by name, from this package or from a user's own (entry points)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import cache
from importlib import metadata
from typing import Any, cast

from pydantic import TypeAdapter, ValidationError

from viewsep.config import Config, PluginConfig, explain
from viewsep.descriptors.joined import JOINT, JoinedDescriptor
from viewsep.errors import BadConfig
from viewsep.interfaces import Descriptor, Interpreter, Planner
from viewsep.models.aspect_graph import AspectGraph
from viewsep.planning.reachable import ReachableViews


@cache
def entry_points(group: str) -> metadata.EntryPoints:
    """What the installed packages register, read once per process: it takes longer than a look."""
    return metadata.entry_points(group=group)


def names(kind: str) -> list[str]:
    """Registered names of a kind: `descriptor`, `interpreter` or `planner`."""
    return sorted({point.name for point in entry_points(group=f"viewsep.{kind}s")})


def make_descriptor(config: PluginConfig) -> Descriptor:
    """The descriptor with its parameters, or several joined by `+`, whose options begin with their names.

    Raises BadConfig.
    """
    if JOINT not in config.name:
        return cast(Descriptor, _options(_find("descriptor", config.name), "descriptor", config))
    names = config.name.split(JOINT)
    if len(set(names)) < len(names):
        raise BadConfig(f"descriptor.name = {config.name!r} names a descriptor twice: join different ones")
    options: dict[str, dict[str, Any]] = {name: {} for name in names}
    for key, value in config.options.items():
        name, _, own = key.partition(".")
        if name not in options or not own:
            raise BadConfig(f"unknown key 'descriptor.options.{key}': write NAME.KEY with a NAME of {', '.join(names)}")
        options[name][own] = value
    return JoinedDescriptor([make_descriptor(PluginConfig(name=name, options=options[name])) for name in names])


def make_interpreter(config: PluginConfig, models: Sequence[AspectGraph], descriptor: Descriptor) -> Interpreter:
    """The interpreter over the candidates' models. Raises BadConfig, BadInput."""
    plugin = _find("interpreter", config.name)
    return cast(Interpreter, plugin(models, descriptor, _options(plugin.options_type, "interpreter", config)))


def make_planner(config: PluginConfig, models: Sequence[AspectGraph], reachable: ReachableViews) -> Planner:
    """The planner over the candidates' models and the rig's views. Raises BadConfig."""
    plugin = _find("planner", config.name)
    return cast(Planner, plugin(models, reachable, _options(plugin.options_type, "planner", config)))


def check_plugins(config: Config) -> None:
    """That the interpreter and the planner exist and have the options given to them. Raises BadConfig."""
    for kind, chosen in (("interpreter", config.interpreter), ("planner", config.planner)):
        chosen_options(kind, chosen)


def options_type(kind: str, name: str) -> type:
    """The dataclass of a plug-in's options; a descriptor is its own. Raises BadConfig."""
    plugin: type = _find(kind, name)
    return plugin if kind == "descriptor" else cast(Any, plugin).options_type


def chosen_options(kind: str, config: PluginConfig) -> Any:
    """A plug-in's options, those not given with their defaults. Raises BadConfig."""
    return _options(options_type(kind, config.name), kind, config)


def _find(kind: str, name: str) -> Any:
    found = [point for point in entry_points(group=f"viewsep.{kind}s") if point.name == name]
    if not found:
        raise BadConfig(
            f"no {kind} is called {name!r}: choose one of {', '.join(names(kind))}, or install the package that has it"
        )
    try:
        return found[0].load()
    except (ImportError, AttributeError) as error:
        raise BadConfig(f"the {kind} {name!r} ({found[0].value}) cannot be loaded: {error}") from error


def _options(options_type: type, kind: str, config: PluginConfig) -> Any:
    """The options dataclass filled from the configuration; unknown keys are errors."""
    known = [field.name for field in fields(options_type)]
    for key in config.options:
        if key not in known:
            raise BadConfig(
                f"unknown key '{kind}.options.{key}': {kind} {config.name!r} has {', '.join(known) or 'no options'}"
            )
    try:
        return TypeAdapter(options_type).validate_python(config.options)
    except ValidationError as error:
        raise BadConfig(f"{kind}.options, {explain(error)}") from error
