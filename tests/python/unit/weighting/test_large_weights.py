"""Weights of problems too large for dense matrices."""

from __future__ import annotations

from dataclasses import replace

import pytest

import sfmcpp
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import ConstraintGroup, Problem
from sfmcpp.model.weight_selection import WeightSelection
from sfmcpp.weighting import statistics
from weight_helpers import gps, street


@pytest.fixture(scope="module")
def drift() -> tuple[Problem, Problem]:
    return street()


def choose(problem: Problem, *groups: ConstraintGroup, weight: str = "auto") -> list[WeightSelection]:
    return sfmcpp.solve(problem.copy(), constraints=groups, weight=weight).group_weights


def test_a_problem_too_large_for_dense_matrices_is_weighed_by_folds(
    drift: tuple[Problem, Problem], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(statistics, "MAX_COLUMNS", 100)
    (chosen,) = choose(drift[0], gps(drift[1], 0.1), weight="k-fold")
    assert chosen.redundancy is None
    assert 0.5 < chosen.sensor_sigma / 0.1 < 2
    with pytest.raises(InvalidArgument, match="240 free parameters of cameras, must be at most 100"):
        choose(drift[0], gps(drift[1], 0.1), weight="loo-approx")


@pytest.mark.parametrize(("sampled", "tolerance"), [(40, 0.02), (13, 0.05)])
def test_a_problem_too_large_for_hat_matrices_gets_the_weight_of_a_small_one(
    drift: tuple[Problem, Problem], monkeypatch: pytest.MonkeyPatch, sampled: int, tolerance: float
) -> None:
    """All members stand for themselves, or a third of them for all; two groups are weighed together."""
    groups = [gps(drift[1], 0.1), replace(gps(drift[1], 0.4, seed=1), name="other")]
    expected = choose(drift[0], *groups)
    monkeypatch.setattr(statistics, "MAX_COLUMNS", 100)
    monkeypatch.setattr(statistics, "_SAMPLED_MEMBERS", sampled)
    for found, wanted in zip(choose(drift[0], *groups), expected, strict=True):
        assert found.sensor_sigma == pytest.approx(wanted.sensor_sigma, rel=tolerance)
        assert found.redundancy == pytest.approx(wanted.redundancy, rel=2 * tolerance)
