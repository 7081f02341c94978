"""What does not go together is refused before anything moves."""

from __future__ import annotations

from pathlib import Path

import pytest
from seed_method import seed_config

from viewsep.assembly import make_engine
from viewsep.errors import BadConfig
from viewsep.models.library import load_library


def test_a_planner_that_needs_probabilities_is_refused_to_an_interpreter_without(seed_look_alikes: Path) -> None:
    models = load_library(seed_look_alikes)
    with pytest.raises(BadConfig, match="planner 'information' plans with probabilities, and 'path' has none"):
        make_engine(seed_config(planner={"name": "information"}), models)
    make_engine(seed_config(), models)
    make_engine(seed_config(planner={"name": "information"}, interpreter={"name": "filter"}), models)


def test_looking_around_is_refused_to_an_interpreter_that_forgets_what_it_saw(seed_look_alikes: Path) -> None:
    models = load_library(seed_look_alikes)
    with pytest.raises(BadConfig, match=r"task\.look_around = 0\.5: interpreter 'path'.*choose interpreter 'filter'"):
        make_engine(seed_config(task={"look_around": 0.5}), models)
    make_engine(seed_config(task={"look_around": 0.5}, interpreter={"name": "filter"}), models)
