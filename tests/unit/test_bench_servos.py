"""The bench of the servo driver; its figures are looked at, not judged."""

from __future__ import annotations

import pytest

from viewsep.bench.servos import measure_servos


@pytest.mark.alone
def test_the_driver_is_measured_beside_the_sdk() -> None:
    figures = measure_servos(0.2, 1_000_000)
    assert list(figures) == [f"{n} servos, {who}" for n in (1, 2, 3) for who in ("driver", "SDK alone")]
    for count in (1, 2, 3):
        driver, alone = figures[f"{count} servos, driver"], figures[f"{count} servos, SDK alone"]
        assert driver["hz"] > 10
        assert alone["hz"] > 10
        assert 0.0 < driver["cpu_share"] < alone["cpu_share"]  # the SDK spins
        assert alone["bytes"] <= driver["bytes"] < alone["bytes"] + 20
