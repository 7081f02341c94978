"""What all tests share: deterministic hypothesis, the scanned objects next to the repository, tests of the physics."""

from __future__ import annotations

import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import hypothesis
import one_thread  # noqa: F401 - before numpy
import pytest
from seed_method import SEED, seed_config
from shell import Shell

from viewsep.config import Config
from viewsep.learning import learn_objects, names_for
from viewsep.models import library
from viewsep.sim.products import ProductSpec, write_product

LOOK_ALIKES = ("generated:7", "generated:7:twin=face")
SHARED = Path(__file__).parents[2] / "shared"

hypothesis.settings.register_profile("viewsep", deadline=None, derandomize=True, print_blob=True, database=None)
hypothesis.settings.load_profile("viewsep")
pytest.register_assert_rewrite("motion_contract", "camera_contract")


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", "needs_pybullet: runs the simulation; skipped where pybullet is not installed")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    if importlib.util.find_spec("pybullet") is None:
        skip = pytest.mark.skip(reason="needs pybullet, which has wheels for CPython 3.11 only")
        for item in items:
            if item.get_closest_marker("needs_pybullet"):
                item.add_marker(skip)


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder with scanned objects, photos and the seed; the test is skipped where it is absent."""
    if not SHARED.is_dir():
        pytest.skip(f"the scanned objects and photos are not there: {SHARED}")
    return SHARED


@pytest.fixture(scope="session")
def product_mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The OBJ file of a generated box with six printed faces."""
    return write_product(ProductSpec(1), tmp_path_factory.mktemp("product"))


@pytest.fixture
def shell(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Shell:
    return Shell(monkeypatch, capsys)


@pytest.fixture(scope="session")
def look_alikes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A library with two generated boxes that differ in one face."""
    return learned(tmp_path_factory.mktemp("library"), 60, Config())


@pytest.fixture(scope="session")
def seed_look_alikes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same boxes as the seed's method knows them."""
    return learned(tmp_path_factory.mktemp("seed_library"), 60, seed_config())


def learned(folder: Path, views: int, config: Config) -> Path:
    pytest.importorskip("pybullet", reason="needs pybullet, which has wheels for CPython 3.11 only")
    for model in learn_objects(LOOK_ALIKES, names_for(LOOK_ALIKES, None), views, config):
        library.save(model, folder)
    return folder


@pytest.fixture
def settings(look_alikes: Path, tmp_path: Path) -> Mapping[str, Any]:
    """A simulated rig whose time runs ten times as fast as ours."""
    service = {"name": "bench", "library": str(look_alikes), "recordings": str(tmp_path / "recordings"), "speed": 10.0}
    return {"camera": {"rate_hz": 8.0}, "service": service}


@pytest.fixture
def seed_settings(settings: Mapping[str, Any], seed_look_alikes: Path) -> Mapping[str, Any]:
    """The same rig with the seed's method, whose tasks have many looks: long enough for something to go wrong."""
    return {**settings, **SEED, "service": {**settings["service"], "library": str(seed_look_alikes)}}
