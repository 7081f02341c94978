"""The seed's own method in one place, for tests of path hypotheses and separating views and for tasks of many looks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from viewsep.config import Config, parse_config

SEED: Mapping[str, Mapping[str, Any]] = {
    "descriptor": {"name": "cch"},
    "interpreter": {"name": "path"},
    "planner": {"name": "separating"},
}
SEED_TOML = "".join(f'[{section}]\nname = "{table["name"]}"\n' for section, table in SEED.items())
SEED_OPTIONS = ("--interpreter", "path", "--planner", "separating")
"""The same for `viewsep separate`, on models with any descriptor."""


def seed_config(**sections: Mapping[str, Any]) -> Config:
    """The seed's method with further sections of the configuration, whose keys go before its own."""
    merged = {name: {**SEED.get(name, {}), **sections.get(name, {})} for name in {**SEED, **sections}}
    return parse_config(merged, "seed_config")
