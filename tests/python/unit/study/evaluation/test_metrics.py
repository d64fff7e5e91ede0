"""Errors of trajectories whose errors are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Trajectory
from sfmcpp.study.evaluation import Statistics, ape, evaluate, mean_3d_error, rpe, scale_ratios
from trajectory_helpers import path


def line(*steps: float) -> np.ndarray:
    """Poses along x, that far apart."""
    poses = np.tile(np.eye(3, 4), (len(steps) + 1, 1, 1))
    poses[1:, 0, 3] = np.cumsum(steps)
    return poses


def test_the_mean_3d_error_is_the_mean_distance() -> None:
    estimate = line(1, 1, 1)
    estimate[:, 1, 3] = [0, 3, 0, 5]
    assert mean_3d_error(estimate, line(1, 1, 1)) == pytest.approx(2.0)


def test_the_scale_ratio_is_the_mean_of_the_ratios_and_not_their_inverse() -> None:
    ratios = scale_ratios(line(2, 3, 8), line(4, 4, 4))
    np.testing.assert_allclose(ratios, [0.5, 0.75, 2.0])


def test_steps_of_a_standing_vehicle_say_nothing_of_the_scale() -> None:
    np.testing.assert_allclose(scale_ratios(line(1, 0.004, 3), line(2, 0.001, 2)), [0.5, 1.5])
    standing = Trajectory(np.arange(4.0), line(0, 0, 0))
    assert evaluate(standing, standing, align_to="none").scale_ratio is None


def test_statistics_are_those_of_their_names() -> None:
    found = Statistics.of(np.array([3.0, 4.0, 0.0, 5.0]))
    expected = Statistics(np.sqrt(12.5), 3.0, 3.5, np.sqrt(3.5), 0.0, 5.0, 50.0)
    assert vars(found) == pytest.approx(vars(expected))


def test_absolute_errors_of_a_known_displacement_and_turn() -> None:
    truth = path(5).poses
    turn, shift = Rotation.from_rotvec(np.deg2rad([0, 10, 0])).as_matrix(), np.array([0.3, 0.0, 0.4])
    estimate = np.concatenate([truth[:, :, :3] @ turn, truth[:, :, 3:] + shift[:, None]], axis=2)
    found = ape(estimate, truth)
    np.testing.assert_allclose(found["translation_part"], 0.5, atol=1e-12)
    np.testing.assert_allclose(found["rotation_angle_deg"], 10.0, atol=1e-12)
    expected = np.sqrt(8 * np.sin(np.deg2rad(5)) ** 2 + 0.25)
    np.testing.assert_allclose(found["full_transformation"], expected, atol=1e-12)


def test_relative_errors_do_not_see_the_frame_and_grow_with_the_drift() -> None:
    truth = Trajectory(np.arange(20.0), line(*[1.0] * 19))
    elsewhere = Rotation.from_rotvec([1.0, 2.0, 3.0]).as_matrix()
    drifting = np.concatenate(
        [elsewhere @ line(*[1.1] * 19)[:, :, :3], elsewhere @ line(*[1.1] * 19)[:, :, 3:]], 2
    )
    for delta, expected in [(1, 0.1), (4, 0.4)]:
        found = rpe(drifting, truth.poses, delta)
        np.testing.assert_allclose(found["translation_part"], expected, atol=1e-12)
        np.testing.assert_allclose(found["rotation_angle_deg"], 0.0, atol=1e-5)


@pytest.mark.parametrize(("all_pairs", "count"), [(False, 4), (True, 16)])
def test_pairs_follow_on_each_other_or_start_everywhere(all_pairs: bool, count: int) -> None:
    poses = line(*[1.0] * 19)
    for unit in ("frames", "m"):
        found = rpe(poses, poses, 4, unit, all_pairs)
        assert [len(errors) for errors in found.values()] == [count] * 3


@pytest.mark.parametrize(
    ("delta", "unit", "told"),
    [
        (0, "frames", "delta = 0: must be finite and positive"),
        (1.5, "frames", r"delta = 1.5 frames: must be a whole number"),
        (99, "frames", "delta = 99 frames: no two poses are that far apart"),
        (99, "m", "delta = 99 m: no two poses"),
        (1, "miles", "delta_unit = 'miles': must be one of frames, m"),
    ],
)
def test_a_distance_that_no_pair_has_is_refused(delta: float, unit: str, told: str) -> None:
    with pytest.raises(InvalidArgument, match=told):
        rpe(line(1, 1, 1), line(1, 1, 1), delta, unit)


def test_an_evaluation_prints_itself_in_a_line() -> None:
    poses = np.tile(np.eye(3, 4), (30, 1, 1))
    poses[:, :, 3] = np.random.default_rng(0).normal(size=(30, 3))
    truth = Trajectory(np.arange(30.0), poses)
    found = evaluate(truth, truth)
    for text in (str(found), repr(found)):
        assert text.startswith("Evaluation(30 pairs of poses, aligned with scale: mean 3-D error ")
        assert "\n" not in text
        assert len(text) < 120
