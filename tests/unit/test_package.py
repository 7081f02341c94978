"""What gets installed: every package folder, under the names of viewsep only, with plug-ins that load."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import pytest

import viewsep
from viewsep.plugins import names

ROOT = Path(__file__).parents[2]
FOLDERS = ("drivers", "recordings", "sim")


@pytest.fixture(scope="module")
def project() -> dict[str, Any]:
    return tomllib.loads((ROOT / "pyproject.toml").read_text())


@pytest.mark.parametrize("name", FOLDERS)
def test_the_general_names_are_refused(name: str) -> None:
    run = subprocess.run(
        [sys.executable, "-c", f"import {name}"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert run.returncode == 1
    assert run.stderr.endswith(f"ImportError: this package is viewsep.{name}; import it by that name\n")


def test_every_package_folder_is_installed(project: dict[str, Any]) -> None:
    inits = [path.relative_to(ROOT) for top in ("viewsep", *FOLDERS) for path in (ROOT / top).rglob("__init__.py")]
    folders = {".".join(path.parent.parts) for path in inits}
    found = {name if name.split(".")[0] == "viewsep" else f"viewsep.{name}" for name in folders}
    assert sorted(found) == sorted(project["tool"]["setuptools"]["packages"])


def test_every_folder_with_code_is_a_package() -> None:
    for top in ("viewsep", *FOLDERS):
        for path in (ROOT / top).rglob("*.py"):
            assert (path.parent / "__init__.py").is_file(), path


@pytest.mark.parametrize("name", FOLDERS)
def test_links_and_package_folders_agree(name: str, project: dict[str, Any]) -> None:
    link = ROOT / "viewsep" / name
    assert link.is_symlink()
    assert link.readlink() == Path("..") / name
    assert project["tool"]["setuptools"]["package-dir"][f"viewsep.{name}"] == name


@pytest.mark.parametrize("kind", ["descriptor", "interpreter", "planner"])
def test_the_plugins_of_the_project_load(kind: str, project: dict[str, Any]) -> None:
    declared = project["project"]["entry-points"][f"viewsep.{kind}s"]
    assert set(declared) <= set(names(kind))
    points = {point.name: point for point in entry_points(group=f"viewsep.{kind}s")}
    for name, target in declared.items():
        assert points[name].value == target
        assert isinstance(points[name].load(), type)


def test_the_command_is_installed(project: dict[str, Any]) -> None:
    (point,) = entry_points(group="console_scripts", name="viewsep")
    assert point.value == project["project"]["scripts"]["viewsep"]
    assert callable(point.load())


def test_the_versions_agree(project: dict[str, Any]) -> None:
    assert viewsep.__version__ == project["project"]["version"]
