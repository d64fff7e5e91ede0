"""Errors of relative poses against SciPy pair by pair, and the area under recall against an integral."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

from model_helpers import AWAY, true_poses
from sfmcpp import InvalidArgument
from sfmcpp.geometry.so3 import exp
from sfmcpp.study.evaluation import auc, relative_pose_errors_deg


def pair_error_deg(estimate: np.ndarray, truth: np.ndarray, i: int, j: int) -> float:
    """The same from 4×4 matrices and SciPy's rotations, with the angle from the cosine."""
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    relative = []
    for poses in (estimate, truth):
        first, second = (np.vstack([poses[row], [0, 0, 0, 1]]) for row in (i, j))
        relative.append(np.linalg.inv(first) @ second)
    turn = rotation.from_matrix(relative[1][:3, :3]).inv() * rotation.from_matrix(relative[0][:3, :3])
    ours, true = (matrix[:3, 3] / np.linalg.norm(matrix[:3, 3]) for matrix in relative)
    return float(np.rad2deg(max(turn.magnitude(), np.arccos(np.clip(ours @ true, -1, 1)))))


def test_errors_are_those_of_every_pair_in_order() -> None:
    truth = true_poses(7)
    rng = np.random.default_rng(4)
    estimate = truth.copy()
    estimate[:, :, :3] = truth[:, :, :3] @ exp(0.05 * rng.normal(size=(7, 3)))
    estimate[:, :, 3] += 0.3 * rng.normal(size=(7, 3))
    found = relative_pose_errors_deg(AWAY.apply_to_poses(estimate), truth)
    expected = [pair_error_deg(estimate, truth, i, j) for i, j in combinations(range(7), 2)]
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_a_mirrored_baseline_is_wrong_by_half_a_turn() -> None:
    truth = true_poses(2)
    estimate = truth.copy()
    estimate[1, :, 3] = 2 * truth[0, :, 3] - truth[1, :, 3]
    assert relative_pose_errors_deg(estimate, truth) == pytest.approx([180])


def test_a_baseline_of_no_length_has_no_direction_to_be_wrong() -> None:
    truth = true_poses(3)
    truth[1, :, 3] = truth[0, :, 3]
    estimate = truth.copy()
    estimate[1, :, 3] += 1e-3
    assert relative_pose_errors_deg(estimate, truth)[0] == pytest.approx(0, abs=1e-5)
    # The other way round: images that moved, in a model in which they did not.
    assert relative_pose_errors_deg(truth, true_poses(3))[0] == pytest.approx(180)


def test_missing_images_are_infinitely_wrong_in_all_their_pairs() -> None:
    truth = true_poses(4)
    estimate = truth.copy()
    estimate[1] = np.nan
    wrong = np.isinf(relative_pose_errors_deg(estimate, truth))
    assert wrong.tolist() == [1 in pair for pair in combinations(range(4), 2)]


@pytest.mark.parametrize("threshold", [1.0, 5.0, 10.0])
@pytest.mark.parametrize("seed", range(4))
def test_auc_is_the_integral_of_the_curve_through_the_errors(seed: int, threshold: float) -> None:
    rng = np.random.default_rng(seed)
    errors = rng.exponential(3.0, 40)
    errors[rng.random(40) < 0.2] = np.inf
    inside = np.sort(errors[errors < threshold])
    # Recall rises straight to each error and stays level after the last one below the threshold.
    at = np.linspace(0, threshold, 200_001)
    nodes, recall = np.concatenate([[0], inside]), np.arange(len(inside) + 1) / 40
    expected = np.interp(at, nodes, recall).mean()
    assert auc(errors, threshold) == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        ([0, 0, 0, 0], 1.0),
        ([np.inf, np.inf], 0.0),
        ([0, np.inf], 0.5),
        ([11, 200], 0.0),
        ([5, np.inf], 0.375),
    ],
)
def test_auc_of_simple_cases(errors: list[float], expected: float) -> None:
    """The last one: straight to a half at 5°, level to 10°: (5 · ½ / 2 + 5 · ½) / 10."""
    assert auc(np.array(errors, dtype=np.float64), 10.0) == pytest.approx(expected)


def test_auc_refuses_what_has_no_area() -> None:
    with pytest.raises(InvalidArgument, match="there are none"):
        auc(np.empty(0), 10.0)
    with pytest.raises(InvalidArgument, match="threshold_deg = 0"):
        auc(np.zeros(3), 0.0)
