"""docs/service.md says what the code does, and its bare client works."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import get_args

import pytest
from fake_service import fake_service
from pydantic import BaseModel

from viewsep.client.errors import BAD_REQUESTS
from viewsep.service.names import PUBLISHED
from viewsep.service.requests import MAX_REQUEST_BYTES, REQUESTS, Code
from viewsep.service.status import Status

DOCUMENT = (Path(__file__).parents[2] / "docs" / "service.md").read_text(encoding="utf-8")


def rows(heading: str) -> list[list[str]]:
    """The cells of the table whose first column is headed so."""
    start = DOCUMENT.index(f"\n\n| {heading} |") + 2
    lines = DOCUMENT[start:].split("\n\n", 1)[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def first_column(heading: str) -> list[str]:
    return [row[0].strip("`") for row in rows(heading)]


def test_the_bare_client_prints_the_status(tmp_path: Path) -> None:
    code = re.search(r"```python bare client\n(.*?)```", DOCUMENT, re.DOTALL)
    assert code is not None
    with fake_service() as service:
        script = tmp_path / "bare.py"
        script.write_text(code[1].replace("tcp/127.0.0.1:7447", service.endpoint))
        ran = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=60, check=False)
        assert ran.returncode == 0, ran.stderr
        assert json.loads(ran.stdout) == service.status


def test_every_field_of_the_status_is_described() -> None:
    assert sorted(first_column("field")) == sorted(fields(Status))


def fields(model: type[BaseModel], prefix: str = "") -> Iterator[str]:
    """Every field below `model` as the document writes it; optional sections stand there by themselves as well."""
    for name, field in model.model_fields.items():
        path = prefix + (field.alias or name)
        inner = [kind for kind in (field.annotation, *get_args(field.annotation)) if _is_model(kind)]
        if not inner:
            yield path
            continue
        if type(None) in get_args(field.annotation):
            yield path
        many = "[]" if Ellipsis in get_args(field.annotation) else ""
        yield from fields(inner[0], f"{path}{many}.")


def _is_model(kind: object) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def test_every_request_and_its_fields_are_described() -> None:
    described = {row[0].strip("`"): row[1] for row in rows("request")}
    assert sorted(described) == sorted(REQUESTS)
    for name, kind in REQUESTS.items():
        for field in set(kind.model_fields) - {"owner", "token"}:
            assert f"`{field}`" in described[name], (name, field)
    assert f"{MAX_REQUEST_BYTES:,} bytes" in DOCUMENT


def test_every_code_is_described_with_its_exit_code() -> None:
    described = {row[0].strip("`"): int(row[2]) for row in rows("code")}
    assert described == {code.value: 2 if code in BAD_REQUESTS else 1 for code in Code}


def test_every_stream_is_described_with_its_schema() -> None:
    described = {row[0].strip("`"): row[1].strip("`") for row in rows("stream")}
    assert described == {topic: kind.DESCRIPTOR.full_name for topic, kind in PUBLISHED.items()}


@pytest.mark.parametrize("example", re.findall(r"```json\n(.*?)```", DOCUMENT, re.DOTALL))
def test_the_examples_are_json(example: str) -> None:
    assert isinstance(json.loads(example), dict)
