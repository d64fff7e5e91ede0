"""Rotations against SciPy's, from tiny angles to half turns, and the similarity that fits best."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from sensor_helpers import angle_between, random_poses
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.geometry.similarity import Similarity, fit_pose_similarity, fit_similarity
from sfmcpp.model import Trajectory

ANGLES = [0.0, 1e-300, 1e-12, 1e-6, 1e-3, 0.5, 2.0, 3.0, 3.0999, 3.1001, np.pi - 1e-6, np.pi - 1e-12]


def vectors_of(angle: float, count: int = 50, seed: int = 0) -> np.ndarray:
    axes = np.random.default_rng(seed).normal(size=(count, 3))
    return angle * axes / np.linalg.norm(axes, axis=1, keepdims=True)


@pytest.mark.parametrize("angle", [*ANGLES, np.pi, 5.0])
def test_exp_is_scipys(angle: float) -> None:
    vectors = vectors_of(angle)
    np.testing.assert_allclose(
        so3.exp(vectors), Rotation.from_rotvec(vectors).as_matrix(), atol=1e-15, rtol=0
    )


@pytest.mark.parametrize("angle", ANGLES)
def test_log_undoes_exp(angle: float) -> None:
    vectors = vectors_of(angle)
    found = so3.log(Rotation.from_rotvec(vectors).as_matrix())
    np.testing.assert_allclose(found, vectors, rtol=0, atol=1e-15 + 4e-15 * angle)


def test_log_of_a_half_turn_is_one_of_its_two_axes() -> None:
    vectors = np.concatenate([vectors_of(np.pi), np.pi * np.eye(3)])
    rotations = Rotation.from_rotvec(vectors).as_matrix()
    found = so3.log(rotations)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), np.pi, rtol=1e-15)
    np.testing.assert_allclose(Rotation.from_rotvec(found).as_matrix(), rotations, atol=1e-14)


def test_log_keeps_the_shape_of_a_batch() -> None:
    vectors = vectors_of(1.0, 12).reshape(3, 4, 3)
    np.testing.assert_allclose(so3.log(so3.exp(vectors)), vectors, atol=1e-14)
    np.testing.assert_allclose(so3.log(so3.exp(vectors[0, 0])), vectors[0, 0], atol=1e-14)


def test_the_nearest_rotation_of_a_reflection_is_a_rotation() -> None:
    mirrored = Rotation.random(rng=np.random.default_rng(3)).as_matrix() @ np.diag([1.0, 1.0, -0.2])
    assert np.linalg.det(so3.nearest_rotation(mirrored)) == pytest.approx(1.0)


def random_similarity(rng: np.random.Generator) -> Similarity:
    return Similarity(float(rng.uniform(0.1, 9)), Rotation.random(rng=rng).as_matrix(), rng.normal(0, 9, 3))


def test_a_similarity_is_found_again_from_points_and_from_poses() -> None:
    rng = np.random.default_rng(5)
    truth, poses = random_similarity(rng), random_poses(rng, 6)
    for found in (
        fit_similarity(poses[:, :, 3], truth.apply(poses[:, :, 3])),
        fit_pose_similarity(poses, truth.apply_to_poses(poses)),
    ):
        assert found.scale == pytest.approx(truth.scale, rel=1e-12)
        np.testing.assert_allclose(found.rotation, truth.rotation, atol=1e-13)
        np.testing.assert_allclose(found.translation, truth.translation, atol=1e-12)


@pytest.mark.parametrize("with_scale", [True, False])
def test_no_other_similarity_fits_noisy_points_better(with_scale: bool) -> None:
    rng = np.random.default_rng(7)
    source = rng.normal(size=(12, 3)) * [5, 3, 1]
    target = random_similarity(rng).apply(source) + rng.normal(0, 0.5, source.shape)
    weights = rng.uniform(0.1, 3, 12)

    def residuals(x: np.ndarray) -> np.ndarray:
        scale = np.exp(x[6]) if with_scale else 1.0
        moved = scale * Rotation.from_rotvec(x[:3]).apply(source) + x[3:6]
        return (np.sqrt(weights)[:, None] * (moved - target)).ravel()

    found = fit_similarity(source, target, weights, with_scale)
    ours = np.array(
        [*Rotation.from_matrix(found.rotation).as_rotvec(), *found.translation, np.log(found.scale)]
    )
    best = least_squares(residuals, ours, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert np.sum(residuals(ours) ** 2) == pytest.approx(2 * best.cost, rel=1e-10)
    assert found.scale == (
        pytest.approx(1.0) if not with_scale else pytest.approx(np.exp(best.x[6]), rel=1e-5)
    )


def test_a_mirrored_copy_is_fitted_by_a_rotation() -> None:
    source = np.random.default_rng(2).normal(size=(8, 3))
    found = fit_similarity(source, source * [1, 1, -1])
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)


def test_points_on_a_line_are_refused_where_poses_on_it_are_not() -> None:
    rng = np.random.default_rng(4)
    truth, poses = random_similarity(rng), random_poses(rng, 6)
    poses[:, :, 3] = np.outer(np.arange(6.0), [1.0, 2.0, 3.0])
    moved = truth.apply_to_poses(poses)
    with pytest.raises(InvalidArgument, match="on a line"):
        fit_similarity(poses[:, :, 3], moved[:, :, 3])
    assert angle_between(fit_pose_similarity(poses, moved).rotation, truth.rotation) < 1e-13


def test_positions_and_orientations_together_fit_better_than_either() -> None:
    """At like accuracy: 0.05 rad, and as much of the spread of the positions."""
    rng = np.random.default_rng(6)
    errors: dict[str, list[float]] = {"both": [], "positions": [], "orientations": []}
    for _ in range(100):
        truth, poses = random_similarity(rng), random_poses(rng, 6, spread_m=5.0)
        moved = truth.apply_to_poses(poses)
        moved[:, :, :3] = moved[:, :, :3] @ Rotation.from_rotvec(rng.normal(0, 0.05, (6, 3))).as_matrix()
        moved[:, :, 3] += rng.normal(0, 0.05 * 5.0 * truth.scale, (6, 3))
        turns = Rotation.from_matrix(moved[:, :, :3] @ poses[:, :, :3].transpose(0, 2, 1))
        found = {
            "both": fit_pose_similarity(poses, moved).rotation,
            "positions": fit_similarity(poses[:, :, 3], moved[:, :, 3]).rotation,
            "orientations": turns.mean().as_matrix(),
        }
        for name, rotation in found.items():
            errors[name].append(angle_between(rotation, truth.rotation))
    medians = {name: np.median(values) for name, values in errors.items()}
    assert medians["both"] < 0.95 * min(medians["positions"], medians["orientations"])


def test_a_similarity_and_its_inverse_cancel() -> None:
    rng = np.random.default_rng(8)
    map_, poses = random_similarity(rng), random_poses(rng, 3)
    np.testing.assert_allclose((map_.inverse() @ map_).apply_to_poses(poses), poses, atol=1e-13)


def test_what_a_camera_sees_does_not_change_under_a_similarity() -> None:
    rng = np.random.default_rng(9)
    map_, pose, points = random_similarity(rng), random_poses(rng, 1)[0], rng.normal(size=(20, 3))

    def direction(pose: np.ndarray, points: np.ndarray) -> np.ndarray:
        in_camera = (points - pose[:, 3]) @ pose[:, :3]
        return in_camera / np.linalg.norm(in_camera, axis=1, keepdims=True)

    moved = direction(map_.apply_to_poses(pose), map_.apply(points))
    np.testing.assert_allclose(moved, direction(pose, points), atol=1e-13)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((np.zeros((3, 3)), np.zeros((4, 3))), "target: shape"),
        ((np.eye(3), np.full((3, 3), np.nan)), r"target\[0, 0\] = nan"),
        ((np.eye(3), np.eye(3), [1, -1, 1]), r"weights\[1\] = -1.0"),
        ((np.eye(3), np.eye(3), [1, 0, 0]), "1 pairs count"),
        ((np.ones((4, 3)), np.ones((4, 3))), "on a line"),
    ],
)
def test_pairs_that_fit_nothing_are_refused(arguments: tuple[np.ndarray, ...], told: str) -> None:
    with pytest.raises(InvalidArgument, match=told):
        fit_similarity(*arguments)


@pytest.mark.parametrize(
    ("t_s", "change", "told"),
    [
        ([0.0, 1.0, 1.0], None, r"t_s\[2\] = 1.0 s is a duplicate"),
        ([0.0, 2.0, 1.0], None, r"t_s\[2\] = 1.0 s is earlier"),
        ([0.0, 1.0, 2.0], (1, 0, 0, np.nan), r"poses\[1, 0, 0\] = nan"),
        ([0.0, 1.0, 2.0], (1, 0, 0, 5.0), r"poses\[1\]: its first three columns are no rotation"),
        ([0.0, 1.0], None, "poses: shape"),
    ],
)
def test_an_impossible_trajectory_is_refused(
    t_s: list[float], change: tuple[int, int, int, float] | None, told: str
) -> None:
    poses = random_poses(np.random.default_rng(0), 3)
    if change is not None:
        poses[change[:3]] = change[3]
    with pytest.raises(InvalidArgument, match=told):
        Trajectory(np.array(t_s), poses)
