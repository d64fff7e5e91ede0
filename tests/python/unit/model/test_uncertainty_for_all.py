"""One standard deviation, or one covariance, for all observations of a problem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import sfmcpp
from sfmcpp import InvalidArgument

COVARIANCE = np.array([[4.0, 1.0], [1.0, 2.0]])


def test_one_sigma_is_that_of_each_observation() -> None:
    problem = sfmcpp.circle_scene(5, 30, seed=0)
    count = problem.num_observations
    one, each = replace(problem, sigma_px=2), replace(problem, sigma_px=np.full(count, 2.0))
    assert one.sigma_px is not None
    np.testing.assert_array_equal(one.sigma_px, np.full(count, 2.0))
    assert sfmcpp.cost(one) == sfmcpp.cost(each) == pytest.approx(sfmcpp.cost(problem) / 4)
    one.sigma_px[0] = 1.0  # an array of its own, whose entries may be changed
    assert (one.sigma_px[1:] == 2.0).all()


def test_one_covariance_is_that_of_each_observation() -> None:
    problem = sfmcpp.circle_scene(5, 30, seed=0)
    count = problem.num_observations
    one = replace(problem, covariance_px2=COVARIANCE)
    each = replace(problem, covariance_px2=np.tile(COVARIANCE, (count, 1, 1)))
    np.testing.assert_array_equal(one.covariance_px2, each.covariance_px2)
    assert sfmcpp.cost(one) == sfmcpp.cost(each)


@pytest.mark.parametrize("sigma_px", [[2.0], [2.0, 3.0], [[2.0]]])
def test_what_is_neither_one_nor_one_for_each_is_refused(sigma_px: list[float]) -> None:
    with pytest.raises(InvalidArgument, match=r"sigma_px: shape .*, must be \(150\)"):
        replace(sfmcpp.circle_scene(5, 30, seed=0), sigma_px=sigma_px)
    with pytest.raises(InvalidArgument, match=r"covariance_px2: shape .*, must be \(150, 2, 2\)"):
        replace(sfmcpp.circle_scene(5, 30, seed=0), covariance_px2=[COVARIANCE, COVARIANCE])


def test_one_sigma_that_is_none_is_refused_by_a_solve() -> None:
    with pytest.raises(InvalidArgument, match="sigma_px"):
        sfmcpp.solve(replace(sfmcpp.circle_scene(5, 30, seed=0), sigma_px=-1.0))
