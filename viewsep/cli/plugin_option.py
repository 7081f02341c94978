"""A plug-in on the command line: NAME[:key=value,...], as in `path:variant=particles,rated_by=w0+w1`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from viewsep.config import PluginConfig
from viewsep.descriptors.joined import JOINT
from viewsep.errors import BadConfig
from viewsep.plugins import chosen_options, make_descriptor, options_type

Kind = Literal["descriptor", "interpreter", "planner"]
LIST_SEPARATOR = "+"
HOW = "write NAME or NAME:key=value,key=value"
_LISTS = (tuple, list, set, frozenset)


def parse_plugin(kind: Kind, text: str) -> PluginConfig:
    """The plug-in that `text` names, with the options it gives and no others, as values of their types.

    Descriptors joined by `+` have options that begin with their names: `opponent+rings:rings.frequencies=5`. The
    elements of a list are joined by `+`, and nothing behind the `=` is the empty list. Raises BadConfig for
    whatever is wrong with it.
    """
    try:
        name, colon, rest = text.partition(":")
        if not name:
            raise BadConfig(f"the name is missing: {HOW}")
        given = _pairs(rest) if colon else {}
        joined = kind == "descriptor" and JOINT in name
        options = _joined_options(name, given) if joined else _typed_options(kind, name, given)
    except BadConfig as error:
        raise BadConfig(f"--{kind} {text!r}: {error}") from error
    return PluginConfig(name=name, options=options)


def onto(configured: PluginConfig, given: PluginConfig | None) -> dict[str, Any]:
    """A section of the configuration with the plug-in `given` instead.

    The same plug-in keeps the configured options that are not given, another one has its defaults.
    """
    if given is None:
        return configured.model_dump()
    kept: Mapping[str, Any] = configured.options if configured.name == given.name else {}
    return {"name": given.name, "options": {**kept, **given.options}}


def _typed_options(kind: Kind, name: str, given: Mapping[str, str]) -> dict[str, Any]:
    """The given options as values of their types. Raises BadConfig."""
    lists = _list_options(options_type(kind, name))
    typed = {key: _split(value) if key in lists else value for key, value in given.items()}
    options = chosen_options(kind, PluginConfig(name=name, options=typed))
    return {key: getattr(options, key) for key in given}


def _joined_options(name: str, given: Mapping[str, str]) -> dict[str, Any]:
    """The same for descriptors joined by `+`: each option begins with the name of its own. Raises BadConfig."""
    parts: dict[str, dict[str, str]] = {part: {} for part in name.split(JOINT)}
    for key, value in given.items():
        part, _, own = key.partition(".")
        if part in parts and own:
            parts[part][own] = value
    typed = {
        f"{part}.{own}": value
        for part, options in parts.items()
        for own, value in _typed_options("descriptor", part, options).items()
    }
    make_descriptor(PluginConfig(name=name, options={**given, **typed}))  # refuses what belongs to none of them
    return typed


def _pairs(text: str) -> dict[str, str]:
    """The keys and values between the commas. Raises BadConfig."""
    given: dict[str, str] = {}
    for piece in text.split(","):
        key, equals, value = piece.partition("=")
        if not key or not equals:
            raise BadConfig(f"{piece!r} is not key=value: {HOW}")
        if key in given:
            raise BadConfig(f"{key!r} is given twice: give it once")
        given[key] = value
    return given


def _split(value: str) -> list[str]:
    return value.split(LIST_SEPARATOR) if value else []


def _list_options(options: type) -> set[str]:
    """Names of the options that take several values."""
    return {name for name, hint in get_type_hints(options, include_extras=True).items() if _is_list(hint)}


def _is_list(hint: Any) -> bool:
    if get_origin(hint) is Annotated:
        return _is_list(get_args(hint)[0])
    return hint in _LISTS or get_origin(hint) in _LISTS
