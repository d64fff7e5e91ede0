"""``solve(..., weight=...)`` with residuals by functions; these do not run on several ranks."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfmcpp import ConstraintGroup, Problem, ResidualGroup
from sfmcpp.weighting import WeightSelection
from weight_helpers import Array, gps, is_recovered, street


def choose(problem: Problem, *groups: ConstraintGroup | ResidualGroup) -> list[WeightSelection]:
    return sfmcpp.solve(problem.copy(), constraints=groups, weight="auto").group_weights


@pytest.mark.parametrize("loss", ["squared", "huber"])
def test_own_residuals_have_the_weight_of_the_constraint_that_they_repeat(loss: str) -> None:
    start, truth = street()
    group = gps(truth, 0.1, loss=loss)
    places, tenth_m = group.values, 0.1
    own = ResidualGroup(lambda poses: (poses[:, :, 3] - places) / tenth_m, group.cameras, loss=loss)
    (expected,), (found,) = choose(start, group), choose(start, own)
    assert found.unit == "units of r"
    assert found.sensor_sigma * tenth_m == pytest.approx(expected.sensor_sigma, rel=0.01)
    assert found.redundancy == pytest.approx(expected.redundancy, rel=0.01)
    assert own.weight == found.weight


def test_depths_and_known_points_are_weighed_together_with_their_own_unit() -> None:
    truth = sfmcpp.circle_scene(20, 200, pixel_sigma_px=1.0, seed=2)
    rng = np.random.default_rng(5)
    cameras, points = truth.camera_index[::5], truth.point_index[::5]

    def depths(poses: Array, places: Array) -> Array:
        return np.asarray(np.einsum("ni,ni->n", poses[:, :, 2], places - poses[:, :, 3]))

    measured = depths(truth.cameras[cameras], truth.points[points]) + rng.normal(0, 0.06, len(cameras))
    known = np.arange(60)
    places = truth.points[known] + rng.normal(0, 0.05, (60, 3))
    groups = [
        ResidualGroup(
            lambda p, x: (depths(p, x) - measured)[:, None] / 0.02, cameras, points=points, name="depth"
        ),
        ResidualGroup(lambda x: x - places, points=known, name="known"),
    ]
    depth, floor = choose(truth, *groups)
    assert is_recovered(depth, 3.0)
    assert is_recovered(floor, 0.05)


def test_own_residuals_beside_a_constraint_keep_their_weight() -> None:
    truth = sfmcpp.circle_scene(20, 200, pixel_sigma_px=1.0, seed=2)
    heights = truth.centres[:, 2] + np.random.default_rng(1).normal(0, 0.2, 20)
    own = ResidualGroup(lambda poses: (poses[:, 2, 3:] - heights[:, None]) / 0.2, np.arange(20), name="own")
    group = gps(truth, 0.1)
    summary = sfmcpp.solve(truth.copy(), constraints=[own, group], weight={"gps": "auto"})
    assert own.weight == 1.0
    assert is_recovered(summary.group_weights[0], 0.1)
