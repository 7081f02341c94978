"""The configurations in docs/deploy.md are valid."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest

from viewsep.config import parse_config
from viewsep.service.transport import check_endpoint

DOCUMENT = (Path(__file__).parents[2] / "docs" / "deploy.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```toml\n(.*?)```", DOCUMENT, re.DOTALL)


def test_there_are_configurations() -> None:
    assert len(BLOCKS) >= 3


@pytest.mark.parametrize("block", BLOCKS)
def test_a_configuration_is_valid(block: str) -> None:
    service = parse_config(tomllib.loads(block), "docs/deploy.md").service
    for key in {"listen", "listen_images", "connect", "connect_images"} & service.model_fields_set:
        for endpoint in getattr(service, key):
            check_endpoint(endpoint, key, bool(service.keys))
