"""Student's t as the law of residuals: what is drawn from it is found again, and it is a density."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from viewsep.interpretation.law import FREEDOMS, Law
from viewsep.messages import FloatArray

SURFACE = {1: 2.0, 2: 2.0 * np.pi, 3: 4.0 * np.pi}  # of the unit sphere


def drawn(dimensions: int, freedom: float, scale2: float, count: int = 20_000, seed: int = 1) -> FloatArray:
    """(count,) squared lengths of vectors drawn from Student's t."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(count, dimensions))
    stretched: FloatArray = scale2 * (normal**2).sum(axis=1) / (rng.chisquare(freedom, count) / freedom)
    return stretched


@pytest.mark.parametrize("dimensions", [1, 5, 24])
@pytest.mark.parametrize("freedom", [3.0, 8.0])
@pytest.mark.parametrize("scale2", [0.01, 4.0])
def test_the_scale_and_the_tail_of_drawn_residuals_are_found(dimensions: int, freedom: float, scale2: float) -> None:
    law = Law.fit(drawn(dimensions, freedom, scale2), dimensions)
    assert law.dimensions == dimensions
    assert law.scale2 == pytest.approx(scale2, rel=0.05)
    assert law.freedom == freedom


def test_normal_residuals_have_the_lightest_tail_there_is() -> None:
    rng = np.random.default_rng(2)
    law = Law.fit((rng.normal(size=(5000, 5)) ** 2).sum(axis=1), 5)
    assert law.freedom == max(FREEDOMS)
    assert law.scale2 == pytest.approx(1.0, rel=0.07)


def test_bad_looks_make_the_tail_heavier_and_move_the_scale_little() -> None:
    clean = drawn(5, 20.0, 1.0, 2000)
    spoilt = np.concatenate([clean, np.full(100, 2000.0)])
    law, usual = Law.fit(spoilt, 5), Law.fit(clean, 5)
    assert law.freedom < usual.freedom
    assert law.scale2 < 1.3 * usual.scale2  # the mean of squares is 20 times as large


def test_the_further_out_a_residual_is_the_less_it_counts() -> None:
    weight = Law(3, 4.0, 2.0).weight(np.array([0.0, 6.0, 600.0]))
    assert weight[0] > weight[1] > weight[2] > 0.0
    assert weight[1] == pytest.approx(1.0)  # where it is as far out as its scale says


@pytest.mark.parametrize("dimensions", [1, 2, 3])
@pytest.mark.parametrize("freedom", [2.0, 12.0])
def test_it_is_a_density(dimensions: int, freedom: float) -> None:
    law = Law(dimensions, freedom, 0.7)

    def shell(radius: float) -> float:
        return SURFACE[dimensions] * radius ** (dimensions - 1) * float(np.exp(law.log(np.array(radius**2))))

    total = quad(shell, 0.0, 10.0, epsrel=1e-5)[0] + quad(shell, 10.0, np.inf, epsrel=1e-5)[0]
    assert total == pytest.approx(1.0, abs=1e-3)


def test_residuals_of_nothing_give_a_law_that_can_be_used() -> None:
    law = Law.fit(np.zeros(10), 3)
    assert np.isfinite(law.log(np.array([0.0, 1.0]))).all()
