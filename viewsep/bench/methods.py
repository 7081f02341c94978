"""The methods an experiment compares: an interpreter, a planner and, for path hypotheses, what rates them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from viewsep.config import Config, InterpreterConfig, PlannerConfig, PluginConfig
from viewsep.errors import BadInput
from viewsep.plugins import check_plugins

ALL_MEASURES = "w0+w1+w2"
MEASURES = (ALL_MEASURES, "w1", "w0+w1")
"""What may decide in the seed's section V.B: all three measures, the path course alone, and with the similarity."""

PATH = "path"
SEED_PLANNER = "separating"
RANDOM_MOTION = "random"  # the planner that is a baseline


@dataclass(frozen=True, slots=True)
class Method:
    """One way of doing the tasks; the name stands in tables, files and pictures."""

    name: str
    config: Config


def methods_for(
    config: Config, interpreters: Sequence[str], planners: Sequence[str], measures: Sequence[str]
) -> list[Method]:
    """Every interpreter with every planner; path hypotheses once for each set of measures that is to decide.

    Where no planner is named an interpreter has its usual one. Options in the configuration belong to the interpreter
    and planner named there. Raises BadInput for measures and BadConfig for plug-ins and options that do not exist.
    """
    for given in measures:
        if given not in MEASURES:
            raise BadInput(f"--measures {given!r} is none of {', '.join(MEASURES)}: name one or several of them")
    methods = []
    named = interpreters or [config.interpreter.name]
    for interpreter, planner in ((name, p) for name in named for p in planners or [usual_planner(config, name)]):
        chosen = config.model_copy(
            update={
                "interpreter": _same_or_new(config.interpreter, interpreter, InterpreterConfig),
                "planner": _same_or_new(config.planner, planner, PlannerConfig),
            }
        )
        suffix = f", {planner}" if len(planners) > 1 else ""
        if interpreter == PATH and measures:
            methods += [Method(f"{PATH} {given}{suffix}", _rated_by(chosen, given)) for given in measures]
        else:
            methods.append(Method(f"{interpreter}{suffix}", chosen))
    for method in methods:
        check_plugins(method.config)
    return methods


def usual_planner(config: Config, interpreter: str) -> str:
    """The planner where no option names one: the configured one, and with path hypotheses by default the seed's.

    They do not say what a view promises, so that the default planner would never end their task.
    """
    chosen = "planner" in config.model_fields_set
    return SEED_PLANNER if interpreter == PATH and not chosen else config.planner.name


def random_motion(method: Method) -> Method:
    """The same method, but driven to random views."""
    config = method.config.model_copy(update={"planner": PlannerConfig(name=RANDOM_MOTION)})
    return Method(f"{method.name}, {RANDOM_MOTION} motion", config)


def _same_or_new(configured: PluginConfig, name: str, kind: type[PluginConfig]) -> PluginConfig:
    return configured if configured.name == name else kind(name=name)


def _rated_by(config: Config, measures: str) -> Config:
    """The same with its final rating made from `measures` only, written as `w0+w1`."""
    options = config.interpreter.options | {"rated_by": measures.split("+")}
    return config.model_copy(update={"interpreter": InterpreterConfig(name=PATH, options=options)})
