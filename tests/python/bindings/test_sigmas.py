"""A σ in place of a weight: of the group, of each member, of each number, for every kind of constraint."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import sfmcpp
from constrained import random_group, scene
from sfmcpp import CONSTRAINT_KINDS, ConstraintGroup, InvalidArgument, Problem
from sfmcpp.weighting.units import sigma_of_weight, unit_of_group

SIGMA = 0.03


def cost(problem: Problem, group: ConstraintGroup) -> float:
    summary = sfmcpp.solve(problem.copy(), constraints=[group], max_iterations=0)
    return float(summary.constraint_costs[group.name][0])


@pytest.mark.parametrize("kind", CONSTRAINT_KINDS)
def test_the_weight_of_a_sigma_amounts_to_that_sigma(kind: str) -> None:
    problem = scene()
    plain = random_group(problem, kind)
    fields = (kind, plain.cameras, plain.values)
    group = ConstraintGroup(*fields, points=plain.points, sigma=SIGMA)
    if not CONSTRAINT_KINDS[kind].compares_images:
        assert sigma_of_weight(unit_of_group(group, problem), group.weight, 1.0) == pytest.approx(SIGMA)
    same = ConstraintGroup(*fields, points=plain.points, sigma=np.full(group.num_members, SIGMA))
    assert cost(problem, group) == pytest.approx(cost(problem, same), rel=1e-12)


def test_an_error_of_one_sigma_costs_a_half() -> None:
    problem = scene()
    one = np.array([0])
    values = problem.centres[one] + [[SIGMA, 0, 0]]
    assert cost(problem, ConstraintGroup("position", one, values, sigma=SIGMA)) == pytest.approx(0.5)
    turned = problem.rotations[one] @ Rotation.from_rotvec([[0, 1e-3, 0]]).as_matrix()
    group = ConstraintGroup("orientation", one, turned, sigma=1e-3)
    assert cost(problem, group) == pytest.approx(0.5, rel=1e-5)
    focal = ConstraintGroup("focal", one, problem.intrinsics[one, 0] * np.exp(0.01), sigma=0.01)
    assert cost(problem, focal) == pytest.approx(0.5)


def test_sigmas_by_number_are_those_of_each_axis() -> None:
    problem = scene()
    sigmas = np.array([0.03, 0.03, 0.12]) * np.arange(1, 7)[:, None]
    values = problem.centres + np.random.default_rng(2).normal(0, 0.1, (6, 3))
    group = ConstraintGroup("position", np.arange(6), values, sigma=sigmas)
    assert cost(problem, group) == pytest.approx(0.5 * np.sum(((problem.centres - values) / sigmas) ** 2))


def test_a_member_that_compares_images_counts_by_its_own_points() -> None:
    problem = scene()
    plain = random_group(problem, "orientation-reprojections")
    points = [problem.points[: 5 + k] for k in range(plain.num_members)]
    assert plain.values is not None
    group = ConstraintGroup(plain.kind, plain.cameras, plain.values, points=points, sigma=2.0)
    np.testing.assert_allclose(group.weight * group.member_weights, [len(x) / 4 for x in points])


@pytest.mark.parametrize(
    ("fields", "told"),
    [
        ({"sigma": 0.0}, r"sigma = 0\.0: must be finite and positive"),
        ({"sigma": -1}, r"sigma = -1\.0: must be finite and positive"),
        ({"sigma": np.nan}, "sigma = nan: must be finite and positive"),
        ({"sigma": np.ones(5)}, r"sigma: shape \(5,\), must be \(6\)"),
        ({"sigma": 1.0, "weight": 2.0}, "sigma: gives the weights: must be alone"),
        ({"sigma": 1.0, "member_weights": np.ones(6)}, "sigma: gives the weights: must be alone"),
        ({"sigma": "wide"}, "sigma = .*must be a number"),
    ],
)
def test_what_is_no_sigma_is_refused_by_name(fields: dict[str, object], told: str) -> None:
    problem = scene()
    with pytest.raises(InvalidArgument, match=r"constraints\['gps'\]." + told):
        ConstraintGroup("position", np.arange(6), problem.centres, name="gps", **fields)  # type: ignore[arg-type]
