"""Similarities against known truth, SciPy's rotations and an optimiser, and what leaves them open."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

import sfmcpp
from random_scenes import Array, angle_between, random_poses
from sfmcpp import InvalidArgument
from sfmcpp.geometry import Similarity, fit_pose_similarity, fit_similarity

SEEDS = st.integers(0, 2**32 - 1)


def random_rotation(rng: np.random.Generator) -> Array:
    return Rotation.from_rotvec(rng.uniform(-1.8, 1.8, 3)).as_matrix()


@settings(max_examples=50, deadline=None)
@given(SEEDS, st.floats(1e-3, 1e3), st.integers(3, 40), st.booleans())
def test_exact_points_give_the_true_similarity(seed: int, scale: float, count: int, flat: bool) -> None:
    rng = np.random.default_rng(seed)
    rotation, translation = random_rotation(rng), rng.normal(0, 5, 3)
    source = rng.standard_normal((count, 3)) * ([1, 1, 0] if flat else [1, 1, 1])
    found = fit_similarity(source, scale * source @ rotation.T + translation)
    assert found.scale == pytest.approx(scale, rel=1e-9)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-7)
    np.testing.assert_allclose(
        found.apply(source), scale * source @ rotation.T + translation, atol=1e-9 * scale + 1e-9
    )


@settings(max_examples=30, deadline=None)
@given(SEEDS)
def test_the_rotation_is_that_of_scipy_with_weights_and_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    source, weights = rng.standard_normal((20, 3)), rng.uniform(0, 2, 20)
    target = source @ random_rotation(rng).T + 0.3 * rng.standard_normal((20, 3)) + [1, 2, 3]
    found = fit_similarity(source, target, weights, with_scale=False)
    mean_source, mean_target = (np.average(x, axis=0, weights=weights) for x in (source, target))
    expected, rssd = Rotation.align_vectors(target - mean_target, source - mean_source, weights=weights)
    np.testing.assert_allclose(found.rotation, expected.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(found.apply(mean_source), mean_target, atol=1e-12)
    assert found.scale == 1.0
    left = np.linalg.norm(found.apply(source) - target, axis=1)
    assert np.sqrt(weights @ left**2) == pytest.approx(rssd, rel=1e-9)


def test_a_weight_of_zero_leaves_a_point_out() -> None:
    rng = np.random.default_rng(6)
    source, target = rng.standard_normal((2, 10, 3))
    some = fit_similarity(source[:7], target[:7])
    weighted = fit_similarity(source, target, np.arange(10) < 7)
    np.testing.assert_allclose(weighted.rotation, some.rotation, atol=1e-12)
    assert weighted.scale == pytest.approx(some.scale)
    np.testing.assert_allclose(weighted.translation, some.translation, atol=1e-12)


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
        ((np.eye(3), np.eye(3), [1, 1]), r"weights: shape \(2,\), must be \(3\)"),
        ((np.eye(3), np.eye(3), [0, 0, 0]), "weights: all zero, at least one must be positive"),
        ((np.zeros((0, 3)), np.zeros((0, 3))), "source: 0 points, must be at least 1"),
        ((np.zeros((3, 2)), np.zeros((3, 3))), r"source: shape \(3, 2\), must be \(any, 3\)"),
        ((np.eye(3), np.eye(3), [1, 0, 0]), "1 pairs count"),
        ((np.eye(3)[:2], np.eye(3)[:2]), "on a line"),
        ((np.ones((4, 3)), np.ones((4, 3))), "on a line"),
    ],
)
def test_pairs_that_fit_nothing_are_refused(arguments: tuple[np.ndarray, ...], told: str) -> None:
    with pytest.raises(InvalidArgument, match=told):
        fit_similarity(*arguments)


@pytest.mark.parametrize("free", [False, True])
def test_a_problem_that_is_moved_sees_what_it_saw(free: bool) -> None:
    problem = sfmcpp.rig_walk_scene(seed=0)
    assert problem.rigs is not None
    if free:
        problem.rigs = problem.rigs.freed()
    cost, centres, map_ = (
        sfmcpp.cost(problem),
        problem.centres.copy(),
        random_similarity(np.random.default_rng(4)),
    )
    map_.move(problem)
    assert sfmcpp.cost(problem) == pytest.approx(cost, rel=1e-9)
    np.testing.assert_allclose(problem.centres, map_.apply(centres))
    np.testing.assert_allclose(problem.rigs.rigid(problem.cameras), problem.cameras, atol=1e-9)


def test_cameras_without_poses_are_not_moved() -> None:
    problem = sfmcpp.as_projective(sfmcpp.circle_scene(4, 30, seed=0))
    with pytest.raises(InvalidArgument, match="projective cameras are not moved by a similarity"):
        Similarity.identity().move(problem)


def test_poses_of_a_small_scene_in_a_map_grid_move() -> None:
    angles = np.linspace(0, 2 * np.pi, 10, endpoint=False)
    source = np.tile(np.eye(3, 4), (10, 1, 1))
    source[:, :2, 3] = 0.1 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    target, origin = source.copy(), np.array([4e5, 5.3e6, 100.0])
    target[:, :, 3] = 2 * source[:, :, 3] + origin
    fitted = fit_pose_similarity(source, target)
    assert fitted.scale == pytest.approx(2, rel=1e-7)
    np.testing.assert_allclose(fitted.translation, origin, rtol=0, atol=1e-8)


def test_positions_that_differ_by_rounding_are_the_same() -> None:
    rng = np.random.default_rng(0)
    source = rng.normal(size=(10, 3))
    target = np.array([4e5, 5.3e6, 100.0]) + rng.normal(0, 1e-9, (10, 3))
    with pytest.raises(InvalidArgument, match="target: all positions are the same"):
        fit_similarity(source, target)
    poses = np.tile(np.eye(3, 4), (2, 10, 1, 1))
    poses[:, :, :, 3] = source, target
    with pytest.raises(InvalidArgument, match="target: all positions are the same"):
        fit_pose_similarity(*poses)
