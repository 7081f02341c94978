"""NAME:key=value,... on the command line: what it means, and one sentence for everything that is wrong with it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.cli.plugin_option import Kind, onto, parse_plugin
from viewsep.config import PluginConfig
from viewsep.errors import BadConfig
from viewsep.interpretation.interpreter import PathOptions
from viewsep.plugins import chosen_options

KINDS: list[Kind] = ["descriptor", "interpreter", "planner"]

path_options = st.fixed_dictionaries(
    {},
    optional={
        "variant": st.sampled_from(["initial", "particles", "loop_free", "accumulated"]),
        "alignment": st.sampled_from(["fig4", "wahba"]),
        "rated_by": st.lists(st.sampled_from(["w0", "w1", "w2"]), max_size=3).map(tuple),
        "hypotheses": st.integers(1, 10_000),
        "converged_below_deg2": st.floats(0, 1e9),
        "plausible_within": st.floats(1, 1e300),
        "longest_path": st.integers(10, 10_000),
    },
)


def written(name: str, options: Mapping[str, Any]) -> str:
    """As a person would type it."""
    pieces = [f"{key}={'+'.join(value) if isinstance(value, tuple) else value}" for key, value in options.items()]
    return f"{name}:{','.join(pieces)}" if pieces else name


@given(path_options)
def test_what_is_written_is_read(options: dict[str, Any]) -> None:
    parsed = parse_plugin("interpreter", written("path", options))
    assert parsed == PluginConfig(name="path", options=options)
    assert [type(value) for value in parsed.options.values()] == [type(value) for value in options.values()]
    assert chosen_options("interpreter", parsed) == PathOptions(**options)


@given(st.sampled_from(KINDS), st.text(max_size=30))
def test_any_other_text_is_one_clear_error(kind: Kind, text: str) -> None:
    with pytest.raises(BadConfig) as error:
        parse_plugin(kind, text + "?")
    assert str(error.value).startswith(f"--{kind} {text + '?'!r}: ")


KEY = st.sampled_from([field.name for field in fields(PathOptions)] + ["", "w9"])
PIECE = st.one_of(st.text(max_size=8), st.tuples(KEY, st.text(max_size=8)).map("=".join))


@given(st.lists(PIECE, max_size=4).map(lambda pieces: "path:" + ",".join(pieces)))
def test_any_options_are_taken_or_refused_in_words(text: str) -> None:
    try:
        parsed = parse_plugin("interpreter", text)
    except BadConfig as error:
        assert str(error).startswith(f"--interpreter {text!r}: ")  # noqa: PT017 - both ends are right
    else:
        assert chosen_options("interpreter", parsed) is not None


@pytest.mark.parametrize(
    ("kind", "text", "options"),
    [
        ("planner", "off", {}),
        ("planner", "off:turned_deg=30", {"turned_deg": 30.0}),
        ("planner", "separating:start=current,step_deg=5", {"start": "current", "step_deg": 5.0}),
        ("interpreter", "path:rated_by=w1", {"rated_by": ("w1",)}),
        ("interpreter", "path:rated_by=", {"rated_by": ()}),
        ("descriptor", "cch:distance_px=3", {"distance_px": 3}),
        ("descriptor", "opponent+rings", {}),
        ("descriptor", "opponent+rings:rings.frequencies=5", {"rings.frequencies": 5}),
        ("descriptor", "rings+cch:cch.distance_px=3,rings.smooth_px=2", {"cch.distance_px": 3, "rings.smooth_px": 2.0}),
    ],
)
def test_every_kind_is_read(kind: Kind, text: str, options: dict[str, Any]) -> None:
    assert parse_plugin(kind, text) == PluginConfig(name=text.partition(":")[0], options=options)


@pytest.mark.parametrize(
    ("kind", "text", "words"),
    [
        ("interpreter", "", "the name is missing: write NAME or NAME:key=value,key=value"),
        ("interpreter", ":variant=initial", "the name is missing"),
        ("interpreter", "paths", "no interpreter is called 'paths': choose one of .*path"),
        ("planner", "path", "no planner is called 'path': choose one of .*off, .*separating.*, or install"),
        ("interpreter", "path:", "'' is not key=value"),
        ("interpreter", "path:variant", "'variant' is not key=value"),
        ("interpreter", "path:=initial", "'=initial' is not key=value"),
        ("interpreter", "path:variant=initial,", "'' is not key=value"),
        ("interpreter", "path:variant=initial;alignment=wahba", "key 'variant' = 'initial;alignment=wahba'"),
        ("interpreter", "path:variant=initial,variant=particles", "'variant' is given twice"),
        ("interpreter", "path:color=red", "unknown key 'interpreter.options.color': interpreter 'path' has variant, "),
        ("interpreter", "path:variant=", "interpreter.options, key 'variant' = '': input should be 'initial', "),
        ("interpreter", "path:hypotheses=0", "key 'hypotheses' = '0': input should be greater than or equal to 1"),
        ("interpreter", "path:hypotheses=many", "key 'hypotheses' = 'many': input should be a valid integer"),
        ("interpreter", "path:converged_below_deg2=nan", "key 'converged_below_deg2' = 'nan': input should be"),
        ("interpreter", "path:rated_by=w0+w9", r"key 'rated_by.1' = 'w9': input should be 'w0', 'w1' or 'w2'"),
        ("interpreter", "path:rated_by=+", "key 'rated_by.0' = ''"),
        ("planner", "off:step_deg=3", "unknown key 'planner.options.step_deg': planner 'off' has turned_deg"),
        ("descriptor", "opponent+sift", "no descriptor is called 'sift'"),
        ("descriptor", "opponent+", "no descriptor is called ''"),
        ("descriptor", "rings+rings", r"'rings\+rings' names a descriptor twice"),
        ("descriptor", "opponent+rings:frequencies=5", "unknown key 'descriptor.options.frequencies': write NAME.KEY"),
        ("descriptor", "opponent+rings:cch.distance_px=5", "unknown key 'descriptor.options.cch.distance_px'"),
        ("descriptor", "opponent+rings:rings.colour=5", "unknown key 'descriptor.options.colour': descriptor 'rings'"),
        ("descriptor", "opponent+rings:rings.frequencies=0", "key 'frequencies' = '0'"),
        ("planner", "off+random", "no planner is called 'off[+]random'"),
        ("descriptor", "cch:distance_px=0", "key 'distance_px' = '0': input should be greater than or equal to 1"),
    ],
)
def test_what_is_wrong_is_said(kind: Kind, text: str, words: str) -> None:
    with pytest.raises(BadConfig, match=words):
        parse_plugin(kind, text)


def test_the_same_plugin_keeps_what_was_configured() -> None:
    configured = PluginConfig(name="path", options={"variant": "initial", "hypotheses": 20})
    given = PluginConfig(name="path", options={"variant": "particles"})
    assert onto(configured, given) == {"name": "path", "options": {"variant": "particles", "hypotheses": 20}}
    assert onto(configured, PluginConfig(name="other")) == {"name": "other", "options": {}}
    assert onto(configured, None) == configured.model_dump()
