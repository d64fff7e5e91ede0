"""The minimum of a parabola through three values."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.geometry.parabola import parabola_minimum


@pytest.mark.parametrize("lowest", [-3.0, -0.4, 0.0, 0.25, 7.0])
@pytest.mark.parametrize("step", [0.1, 1.0, 5.0])
def test_the_minimum_of_a_parabola_is_found(lowest: float, step: float) -> None:
    values = 3.0 * (np.array([-step, 0.0, step]) - lowest) ** 2 - 2.0
    found, second_difference = parabola_minimum(*values, step)
    assert found == pytest.approx(lowest, abs=1e-12)
    assert second_difference == pytest.approx(2 * 3.0 * step**2)


@pytest.mark.parametrize("values", [(1.0, 1.0, 1.0), (3.0, 2.0, 1.0), (0.0, 1.0, 0.0), (np.nan, 0.0, 1.0)])
def test_without_a_minimum_it_stays_in_the_middle(values: tuple[float, float, float]) -> None:
    found, second_difference = parabola_minimum(*values)
    assert found == 0.0
    assert not second_difference > 0
