"""Which cameras share points: clusters that are hardly linked, and a chain that meets itself."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

from sfmcpp import Problem, add_outliers, drive_with_loops_scene, perturb, photo_collection_scene

LANDMARKS, VISITORS = 4, 100


@pytest.fixture(scope="module")
def photos() -> Problem:
    return photo_collection_scene(LANDMARKS * VISITORS, cameras_per_landmark=VISITORS, seed=2)


def shared_points(problem: Problem) -> NDArray[np.float64]:
    """(C, C) how many points each two cameras both see."""
    seen = csr_matrix((np.ones(problem.num_observations), (problem.camera_index, problem.point_index)))
    return np.asarray((seen @ seen.T).todense())


def test_photos_of_one_landmark_nearly_all_share_points(photos: Problem) -> None:
    linked = shared_points(photos).reshape(LANDMARKS, VISITORS, LANDMARKS, VISITORS) > 0
    for landmark in range(LANDMARKS):
        assert linked[landmark, :, landmark].mean() > 0.75


def test_few_photos_link_two_landmarks_and_all_of_them_hang_together(photos: Problem) -> None:
    linked = shared_points(photos).reshape(LANDMARKS, VISITORS, LANDMARKS, VISITORS) > 0
    between = linked.any(axis=(1, 3)) & ~np.eye(LANDMARKS, dtype=bool)
    assert (np.linalg.matrix_power(between + np.eye(LANDMARKS), LANDMARKS) > 0).all()
    apart = ~np.eye(LANDMARKS, dtype=bool)
    assert linked.transpose(0, 2, 1, 3)[apart].mean() < 0.1


def test_tracks_of_photos_are_heavy_tailed(photos: Problem) -> None:
    lengths = np.bincount(photos.point_index)
    lengths_of_at_least = np.array([3, 4, 5, 7])
    shares = [(lengths >= length).mean() for length in lengths_of_at_least]
    np.testing.assert_allclose(shares, (2 / lengths_of_at_least) ** 1.45, atol=0.1)
    assert lengths.max() > 0.3 * VISITORS


def test_no_photo_shows_the_back_of_a_tower(photos: Problem) -> None:
    # On a tower about a vertical axis, what faces a camera lies before the plane through the axis.
    feet_x = 60.0 * np.round(photos.points[:, 0] / 60.0)
    feet_y = 150.0 * np.round(photos.points[:, 1] / 150.0)
    outwards = photos.points[:, :2] - np.column_stack([feet_x, feet_y])
    to_camera = (photos.centres[photos.camera_index] - photos.points[photos.point_index])[:, :2]
    assert (np.einsum("mi,mi->m", to_camera, outwards[photos.point_index]) > 0).all()


def test_focal_lengths_spread_as_asked() -> None:
    focals_px = photo_collection_scene(2000, 4000, focal_px=900.0, focal_spread=0.2).intrinsics[:, 0]
    np.testing.assert_allclose(np.log(focals_px / 900).std(), 0.2, rtol=0.1)
    assert 450 <= focals_px.min() <= focals_px.max() <= 1800
    equal = photo_collection_scene(50, 500, focal_px=900.0, focal_spread=0.0).intrinsics[:, 0]
    np.testing.assert_allclose(equal, 900.0)


def test_every_tenth_photo_has_outliers_when_asked(photos: Problem) -> None:
    noisy, wrong = add_outliers(photos, 0.1, seed=1)
    assert wrong.mean() == pytest.approx(0.1, abs=1e-4)
    np.testing.assert_array_equal(noisy.pixels[~wrong], photos.pixels[~wrong])


def test_a_start_has_focal_lengths_off_by_the_share_asked(photos: Problem) -> None:
    start = perturb(photos, focal_sigma=0.05, seed=3)
    off = np.log(start.intrinsics[:, 0] / photos.intrinsics[:, 0])
    np.testing.assert_allclose(off.std(), 0.05, rtol=4 / np.sqrt(2 * len(off)))
    np.testing.assert_array_equal(start.intrinsics[:, 1:], photos.intrinsics[:, 1:])
    np.testing.assert_array_equal(start.cameras, photos.cameras)


def test_noise_on_focal_lengths_changes_no_other_noise_and_nothing_fixed(photos: Problem) -> None:
    held = photos.copy().set_free_intrinsics()
    with_it, without = (
        perturb(held, position_sigma_m=0.1, focal_sigma=sigma, seed=3) for sigma in (0.05, 0.0)
    )
    np.testing.assert_array_equal(with_it.cameras, without.cameras)
    np.testing.assert_array_equal(with_it.intrinsics, photos.intrinsics)


def test_a_drive_is_a_chain_of_which_some_cameras_meet_a_way_of_long_ago() -> None:
    shared = shared_points(drive_with_loops_scene(1500, 30_000)) > 0
    first, second = np.nonzero(shared)
    apart = np.abs(first - second)
    meets_again = np.unique(first[apart > 150])
    assert 0.1 < len(meets_again) / len(shared) < 0.5
    # One of the loops is that around everything.
    assert apart.max() > 1200
    assert (apart <= 40).mean() > 0.6


@pytest.mark.parametrize("num_cameras", [1100, 2900])
def test_the_drive_comes_back_to_its_start(num_cameras: int) -> None:
    centres = drive_with_loops_scene(num_cameras, 2000).centres
    assert np.linalg.norm(centres[100:] - centres[0], axis=1).min() < 3.0
    driven = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    assert driven.max() < 3.0 + 1e-9
