"""Perturbed starts: the asked magnitudes, of the asked quantities, and nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

from sfmcpp import InvalidArgument, Problem
from sfmcpp.sources.synthetic import circle_scene, perturb


@pytest.fixture(scope="module")
def scene() -> Problem:
    return circle_scene(2000, 3000, image_size=(8, 8), seed=11)


def rotation_steps_deg(start: Problem, end: Problem) -> NDArray[np.float64]:
    """Rotation vector w of each camera in ``R_end = R_start exp([w]×)``, by an independent library."""
    relative = Rotation.from_matrix(start.rotations).inv() * Rotation.from_matrix(end.rotations)
    steps_deg: NDArray[np.float64] = np.rad2deg(relative.as_rotvec())
    return steps_deg


def test_points_move_by_the_asked_standard_deviation_and_nothing_else_does(scene: Problem) -> None:
    moved = perturb(scene, point_sigma_m=0.5, seed=1)
    steps = moved.points - scene.points
    np.testing.assert_allclose(steps.std(axis=0), 0.5, rtol=0.05)
    np.testing.assert_allclose(steps.mean(axis=0), 0.0, atol=0.04)
    np.testing.assert_array_equal(moved.cameras, scene.cameras)


def test_centres_move_by_the_asked_standard_deviation_and_nothing_else_does(scene: Problem) -> None:
    moved = perturb(scene, position_sigma_m=1.0, seed=2)
    np.testing.assert_allclose((moved.centres - scene.centres).std(axis=0), 1.0, rtol=0.07)
    np.testing.assert_array_equal(moved.rotations, scene.rotations)
    np.testing.assert_array_equal(moved.points, scene.points)


@pytest.mark.parametrize("sigma_deg", [1e-6, 15.0])
def test_rotations_turn_by_the_asked_standard_deviation_about_each_axis(
    scene: Problem, sigma_deg: float
) -> None:
    moved = perturb(scene, rotation_sigma_deg=sigma_deg, seed=3)
    steps_deg = rotation_steps_deg(scene, moved)
    np.testing.assert_allclose(steps_deg.std(axis=0), sigma_deg, rtol=0.07)
    np.testing.assert_allclose(steps_deg.mean(axis=0), 0.0, atol=0.1 * sigma_deg)
    np.testing.assert_array_equal(moved.centres, scene.centres)


def test_perturbed_rotations_stay_rotations(scene: Problem) -> None:
    rotations = perturb(scene, rotation_sigma_deg=60.0, seed=4).rotations
    products = rotations @ rotations.transpose(0, 2, 1)
    np.testing.assert_allclose(products, np.broadcast_to(np.eye(3), products.shape), atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(rotations), 1.0)


def test_the_original_and_its_observations_are_untouched(scene: Problem) -> None:
    points, cameras = scene.points.copy(), scene.cameras.copy()
    moved = perturb(scene, point_sigma_m=1.0, position_sigma_m=1.0, rotation_sigma_deg=5.0, seed=5)
    np.testing.assert_array_equal(scene.points, points)
    np.testing.assert_array_equal(scene.cameras, cameras)
    np.testing.assert_array_equal(moved.pixels, scene.pixels)


def test_the_level_of_one_kind_of_noise_does_not_change_another(scene: Problem) -> None:
    alone = perturb(scene, rotation_sigma_deg=5.0, seed=6)
    together = perturb(scene, rotation_sigma_deg=5.0, point_sigma_m=1.0, position_sigma_m=2.0, seed=6)
    np.testing.assert_array_equal(alone.rotations, together.rotations)


def test_equal_seeds_of_scene_and_start_give_independent_noise() -> None:
    scene = circle_scene(2, 5000, seed=8)
    steps = perturb(scene, point_sigma_m=1.0, seed=8).points - scene.points
    assert abs(np.corrcoef(scene.points.ravel(), steps.ravel())[0, 1]) < 0.03


def test_the_seed_decides_everything(scene: Problem) -> None:
    first, again, other = (perturb(scene, point_sigma_m=1.0, seed=seed) for seed in (9, 9, 10))
    np.testing.assert_array_equal(first.points, again.points)
    assert not np.array_equal(first.points, other.points)


def test_fixed_points_and_cameras_stay() -> None:
    scene = circle_scene(4, 20)
    scene.fixed_points[5] = True
    scene.fixed_cameras[0] = True
    moved = perturb(scene, point_sigma_m=1.0, position_sigma_m=1.0, rotation_sigma_deg=5.0, seed=1)
    np.testing.assert_array_equal(moved.cameras[0], scene.cameras[0])
    np.testing.assert_array_equal(np.flatnonzero((moved.points == scene.points).all(axis=1)), [5])
    assert (moved.cameras[1:] != scene.cameras[1:]).all()


@pytest.mark.parametrize("name", ["point_sigma_m", "position_sigma_m", "rotation_sigma_deg"])
@pytest.mark.parametrize("value", [-1.0, float("nan"), float("inf")])
def test_a_bad_standard_deviation_is_named_with_its_value(name: str, value: float) -> None:
    with pytest.raises(InvalidArgument, match=f"{name} = {value}"):
        perturb(circle_scene(2, 5), seed=0, **{name: value})
