"""A library of two look-alikes, and settings of a service that uses it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from viewsep.config import Config
from viewsep.learning import learn_objects, names_for
from viewsep.models import library

SOURCES = ("generated:7", "generated:7:twin=face")


@pytest.fixture(scope="session")
def look_alikes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library with two generated boxes that differ in one face."""
    pytest.importorskip("pybullet", reason="needs pybullet, which has wheels for CPython 3.11 only")
    folder = tmp_path_factory.mktemp("library")
    for model in learn_objects(SOURCES, names_for(SOURCES, None), 60, Config()):
        library.save(model, folder)
    return folder


@pytest.fixture
def settings(look_alikes: Path, tmp_path: Path) -> Mapping[str, Any]:
    """A simulated rig whose time runs twenty times as fast as ours."""
    service = {"name": "bench", "library": str(look_alikes), "recordings": str(tmp_path / "recordings"), "speed": 20.0}
    return {"service": service}
