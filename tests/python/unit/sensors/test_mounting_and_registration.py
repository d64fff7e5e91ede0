"""From body to camera, and from a map without scale to metres."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from random_scenes import angle_between, random_poses
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.similarity import Similarity
from sfmcpp.sensors import (
    Mounting,
    find_misalignment,
    register_by_distances,
    register_by_poses,
    register_by_positions,
)


def random_mounting(rng: np.random.Generator) -> Mounting:
    return Mounting(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))


def test_a_point_is_at_the_same_place_in_the_camera_by_either_way() -> None:
    rng = np.random.default_rng(1)
    mounting, body, points = random_mounting(rng), random_poses(rng, 4), rng.normal(size=(4, 3))
    in_body = np.einsum("nji,nj->ni", body[:, :, :3], points - body[:, :, 3])
    expected = (in_body - mounting.lever_arm_m) @ mounting.camera_from_body.T
    camera = mounting.camera_poses(body)
    in_camera = np.einsum("nji,nj->ni", camera[:, :, :3], points - camera[:, :, 3])
    np.testing.assert_allclose(in_camera, expected, atol=1e-13)
    np.testing.assert_allclose(mounting.body_poses(camera), body, atol=1e-13)


def test_rotations_of_the_body_turn_into_those_between_the_camera_s_poses() -> None:
    rng = np.random.default_rng(2)
    mounting, (start, end) = random_mounting(rng), random_poses(rng, 2)
    turn = start[:, :3].T @ end[:, :3]
    first, second = mounting.camera_poses(np.stack([start, end]))
    np.testing.assert_allclose(mounting.camera_rotation(turn), first[:, :3].T @ second[:, :3], atol=1e-13)


def test_a_forward_looking_camera_sees_the_road_ahead_and_below() -> None:
    camera = Mounting.forward_looking().camera_poses(np.eye(3, 4))
    ahead_right_below = np.array([10.0, -2.0, -1.5]) @ camera[:, :3]
    np.testing.assert_allclose(ahead_right_below, [2.0, 1.5, 10.0])


def test_a_mounting_that_is_no_rotation_is_refused() -> None:
    with pytest.raises(InvalidArgument, match="off by 0, with determinant -1: must be orthonormal"):
        Mounting(np.diag([1.0, 1.0, -1.0]), np.zeros(3))
    with pytest.raises(InvalidArgument, match=r"camera_from_body: is off by 0\.04, with determinant 1\.02"):
        Mounting(np.diag([1.0, 1.02, 1.0]), np.zeros(3))


@pytest.mark.parametrize("decimals", [3, 4, 6])
def test_a_mounting_with_a_few_decimals_is_the_nearest_rotation(decimals: int) -> None:
    exact = random_mounting(np.random.default_rng(4)).camera_from_body
    taken = Mounting(exact.round(decimals), np.zeros(3)).camera_from_body
    np.testing.assert_allclose(taken @ taken.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(taken, exact, atol=10.0**-decimals)


def steps_and_directions(turned_deg: float, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Steps by a mounting that is off about the vertical, and where images see them go: a fifth is wrong."""
    rng = np.random.default_rng(5)
    steps = rng.normal([0.0, 0.0, 2.0], 0.2, (count, 3))
    seen = Rotation.from_rotvec(np.radians([0.0, turned_deg, 0.0])).apply(steps)
    seen = seen / np.linalg.norm(seen, axis=1)[:, None] + rng.normal(0.0, 0.02, (count, 3))
    seen[::5] = rng.normal(size=(len(seen[::5]), 3))
    return steps, seen / np.linalg.norm(seen, axis=1)[:, None]


@pytest.mark.parametrize(("turned_deg", "count"), [(5.0, 30), (-5.0, 30), (8.0, 12)])
def test_a_camera_turned_from_its_mounting_is_found(turned_deg: float, count: int) -> None:
    found = find_misalignment(*steps_and_directions(turned_deg, count))
    assert found is not None
    turned = Rotation.from_matrix(found).as_rotvec(degrees=True)
    np.testing.assert_allclose(turned, [0.0, turned_deg, 0.0], atol=1.2)


@pytest.mark.parametrize("turned_deg", [30.0, 90.0, -90.0, 120.0])
def test_wrong_axes_are_found_with_their_whole_angle(turned_deg: float) -> None:
    found = find_misalignment(*steps_and_directions(turned_deg, 60))
    assert found is not None
    turned = Rotation.from_matrix(found).as_rotvec(degrees=True)
    np.testing.assert_allclose(turned, [0.0, turned_deg, 0.0], atol=4.0)


@pytest.mark.parametrize("turned_deg", [0.0, 10.0, -30.0])
def test_reversed_steps_are_a_half_turn_about_the_vertical(turned_deg: float) -> None:
    steps, seen = steps_and_directions(turned_deg, 60)
    found = find_misalignment(steps * [-1.0, 1.0, -1.0], seen)
    assert found is not None
    rest = Rotation.from_matrix(found) * Rotation.from_rotvec([0.0, np.pi, 0.0])
    np.testing.assert_allclose(rest.as_rotvec(degrees=True), [0.0, turned_deg, 0.0], atol=2.5)


@pytest.mark.parametrize(("turned_deg", "count"), [(0.0, 30), (1.5, 30), (5.0, 5), (5.0, 0)])
def test_little_and_few_steps_are_no_misalignment(turned_deg: float, count: int) -> None:
    assert find_misalignment(*steps_and_directions(turned_deg, count)) is None


def shrunken(poses: np.ndarray, seed: int = 3) -> tuple[np.ndarray, Similarity]:
    """The same poses in the frame and the scale of a monocular map, and the way back."""
    rng = np.random.default_rng(seed)
    back = Similarity(20.0, Rotation.random(rng=rng).as_matrix(), rng.normal(0, 10, 3))
    return back.inverse().apply_to_poses(poses), back


def test_registration_brings_the_map_back_and_uses_the_first_pairs_only() -> None:
    truth = random_poses(np.random.default_rng(4), 9)
    vision, back = shrunken(truth)
    measured = truth.copy()
    measured[6:, :, 3] += 100.0
    for found in (
        register_by_poses(vision, measured),
        register_by_positions(vision, measured[:, :, 3]),
    ):
        np.testing.assert_allclose(found.similarity.apply_to_poses(vision), truth, atol=1e-10)
        assert found.similarity.scale == pytest.approx(back.scale)
        assert found.rmse_m < 1e-10
        assert len(found.residuals_m) == 6


def test_all_pairs_register_better_than_the_last_one() -> None:
    """The thesis takes rotation and translation from the last pair (§5.3.3.1)."""
    rng = np.random.default_rng(5)
    ours, lasts = [], []
    for seed in range(40):
        truth = random_poses(rng, 6)
        vision, back = shrunken(truth, seed)
        noise = Rotation.from_rotvec(rng.normal(0, 0.02, (6, 3))).as_matrix()
        measured = np.concatenate(
            [truth[:, :, :3] @ noise, truth[:, :, 3:] + rng.normal(0, 0.1, (6, 3, 1))], axis=2
        )
        found = register_by_poses(vision, measured).similarity.rotation
        ours.append(angle_between(found, back.rotation))
        lasts.append(angle_between(measured[-1, :, :3] @ vision[-1, :, :3].T, back.rotation))
    assert np.median(ours) < 0.6 * np.median(lasts)


def test_a_straight_road_registers_by_poses_and_not_by_positions() -> None:
    truth = random_poses(np.random.default_rng(6), 6)
    truth[:, :, 3] = np.outer(np.arange(6.0), [3.0, 1.0, 0.0])
    vision, _ = shrunken(truth)
    np.testing.assert_allclose(
        register_by_poses(vision, truth).similarity.apply_to_poses(vision), truth, atol=1e-10
    )
    with pytest.raises(InvalidArgument, match="on a line"):
        register_by_positions(vision, truth[:, :, 3])


def test_distances_give_the_scale_of_thesis_eq_5_19() -> None:
    truth = random_poses(np.random.default_rng(7), 8)
    vision, back = shrunken(truth)
    steps = np.linalg.norm(np.diff(truth[:, :, 3], axis=0), axis=1)
    noisy = steps * np.random.default_rng(8).normal(1, 0.05, 7)
    seen = np.linalg.norm(np.diff(vision[:, :, 3], axis=0), axis=1)
    found = register_by_distances(vision, noisy, pairs=6)
    assert found.similarity.scale == pytest.approx(np.mean(noisy[:5]) / np.mean(seen[:5]), rel=1e-12)
    assert register_by_distances(vision, steps).similarity.scale == pytest.approx(back.scale)
    np.testing.assert_allclose(found.similarity.apply_to_poses(vision)[0], vision[0], atol=1e-14)


@pytest.mark.parametrize(
    ("count", "distances", "told"),
    [
        (5, np.ones(9), "vision: there are 5 poses, must be 6"),
        (9, np.ones(4), "distances_m: there are 4, must be 5"),
        (9, np.zeros(9), "distances_m: nothing moved in the first 6 poses"),
    ],
)
def test_too_little_to_register_by_is_refused(count: int, distances: np.ndarray, told: str) -> None:
    poses = random_poses(np.random.default_rng(9), count)
    with pytest.raises(InvalidArgument, match=told):
        register_by_distances(poses, distances)


def test_a_camera_that_stands_is_refused() -> None:
    poses = random_poses(np.random.default_rng(9), 6)
    standing = poses.copy()
    standing[:, :, 3] = [1.0, 2.0, 3.0]
    with pytest.raises(InvalidArgument, match="vision: nothing moved"):
        register_by_distances(standing, np.ones(5))
    with pytest.raises(InvalidArgument, match="vision: all 6 positions are the same"):
        register_by_poses(standing, poses)
