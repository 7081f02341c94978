"""What all tests share: deterministic hypothesis, the scanned objects next to the repository, tests of the physics."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
from hypothesis import settings
from shell import Shell

from viewsep.sim.products import ProductSpec, write_product

SHARED = Path(__file__).parents[2] / "shared"

settings.register_profile("viewsep", deadline=None, derandomize=True, print_blob=True, database=None)
settings.load_profile("viewsep")
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
