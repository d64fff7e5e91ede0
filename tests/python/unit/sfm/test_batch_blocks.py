"""Depths, factorisation and constraints of batch factorisation, against scenes of known cameras."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import sfmcpp
from batch_scenes import measured_of, random_homography, true_cameras, turntable
from sfmcpp.ba.projective import matrices_to_pixels
from sfmcpp.sfm.batch.blocks import (
    Block,
    Factors,
    balanced_depths,
    chained_depths,
    depth_ratios,
    factorise,
    factorised_blocks,
)
from sfmcpp.sfm.batch.constraints import connected_blocks, joint_cameras
from sfmcpp.sfm.batch.pairs import pair_geometries, plausible_observations
from sfmcpp.study.evaluation.projective import projective_errors_px

pytest.importorskip("poselib", reason="fundamental matrices need the extra 'vision'")


def exact_block(count: int = 5) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Rays (s, n, 3), true depths (s, n) and cameras (s, 3, 4) of a turntable's first images."""
    scene = turntable(12, 60)
    measured = measured_of(scene)
    images = list(range(count))
    rows = measured.common_rows(images)
    cameras = true_cameras(scene, measured)[:count]
    points = np.c_[scene.points, np.ones(scene.num_points)][measured.track[rows[0]]]
    return measured.rays[rows], cameras[:, 2] @ points.T, cameras


def fundamental(camera_1: NDArray[np.float64], camera_2: NDArray[np.float64]) -> NDArray[np.float64]:
    """``q₁ᵀ F q₂ = 0`` from the camera matrices: the epipole of centre 2 across what 2 sees on any depth."""
    centre = np.linalg.svd(camera_2)[2][3]
    x, y, z = camera_1 @ centre
    across = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix = across @ camera_1 @ np.linalg.pinv(camera_2)
    return np.asarray(matrix / np.linalg.norm(matrix))


def test_depth_ratios_are_the_true_ones_up_to_one_factor() -> None:
    rays, depths, cameras = exact_block(2)
    ratio = depth_ratios(fundamental(*cameras), rays[0], rays[1]) / (depths[0] / depths[1])
    np.testing.assert_allclose(ratio / ratio[0], 1.0, rtol=1e-9)


def test_chained_depths_are_the_true_ones_up_to_a_factor_for_each_image_and_track() -> None:
    rays, depths, cameras = exact_block(4)
    pairs = {(a, b): fundamental(cameras[a], cameras[b]) for a, b in [(0, 1), (1, 2), (1, 3)]}
    ratio = chained_depths(rays, pairs, [0, 0, 1, 1]) / depths
    # Of rank one: a factor of the image times one of the track.
    np.testing.assert_allclose(ratio * ratio[0, 0], ratio[:, :1] * ratio[:1], rtol=1e-8)


@pytest.mark.parametrize("count", [3, 5, 8])
def test_an_exact_full_matrix_has_exact_factors(count: int) -> None:
    rays, depths, _ = exact_block(count)
    scaled = depths * np.linspace(0.5, 2, count)[:, None] * np.linspace(0.1, 3, depths.shape[1])
    factors = factorise(rays, scaled)
    assert factors.errors(rays).max() < 1e-9
    assert (factors.depths > 0).all()


def test_wrong_depths_settle_at_right_ones() -> None:
    rays, _, _ = exact_block(6)
    start = factorise(rays, np.ones(rays.shape[:2]), iterations=0).errors(rays)
    settled = factorise(rays, np.ones(rays.shape[:2]), iterations=300).errors(rays)
    assert np.median(settled) < 0.2 * np.median(start)


def test_balanced_columns_and_images_weigh_the_same() -> None:
    rays, depths, _ = exact_block(5)
    weights = (rays**2).sum(axis=2) * balanced_depths(
        rays, depths * np.linspace(1, 50, 5)[:, None], rounds=20
    ) ** 2
    np.testing.assert_allclose(weights.mean(axis=1), 1.0, rtol=1e-9)
    np.testing.assert_allclose(weights.mean(axis=0), 1.0, rtol=1e-6)


def test_blocks_in_any_frame_at_any_scale_give_the_true_cameras() -> None:
    scene = turntable(10, 80)
    measured = measured_of(scene)
    cameras = true_cameras(scene, measured)
    rng = np.random.default_rng(1)
    blocks = []
    for first in range(8):
        images = [first, first + 1, first + 2]
        frame = random_homography(first)
        scale = rng.uniform(0.2, 5.0, 3)
        rows = measured.common_rows(images)
        tracks = measured.track[rows[0]]
        points = np.c_[scene.points, np.ones(scene.num_points)][tracks] @ np.linalg.inv(frame).T
        factors = Factors(scale[:, None, None] * (cameras[images] @ frame), points)
        blocks.append(Block(images, tracks, factors, 0.1))
    found = joint_cameras(*connected_blocks(blocks), 10)
    estimate = sfmcpp.projective_problem(
        matrices_to_pixels(found, measured.frames),
        *_triangulated(found, scene),
        scene.camera_index,
        scene.point_index,
        scene.pixels,
    )
    assert projective_errors_px(estimate, scene).max() < 1e-4


def _triangulated(cameras: NDArray[np.float64], scene: sfmcpp.Problem) -> list[NDArray[np.float64]]:
    """Points (N, 4) by a dense null space each."""
    measured = measured_of(scene)
    points = []
    for track in range(scene.num_points):
        rows = np.flatnonzero(measured.track == track)
        seen, ray = cameras[measured.image[rows]], measured.rays[rows]
        equations = ray[:, :2, None] * seen[:, None, 2] - seen[:, :2]
        points.append(np.linalg.svd(equations.reshape(-1, 4))[2][3])
    return [np.array(points)]


def test_blocks_that_share_too_little_are_left_out() -> None:
    scene = turntable(8, 60)
    measured = measured_of(scene)
    pairs = pair_geometries(measured, 2.0, 0)
    blocks = factorised_blocks(measured, pairs, plausible_observations(measured, pairs), 2.0)
    apart = [b for b in blocks if max(b.images) < 5] + [b for b in blocks if min(b.images) >= 5]
    kept, scales = connected_blocks(apart)
    assert {image for block in kept for image in block.images} == {0, 1, 2, 3, 4}
    assert [len(scale) for scale in scales] == [len(block.images) for block in kept]


def test_wrong_observations_are_told_by_pairs_of_images() -> None:
    scene = turntable(10, 200, sigma_px=1.0)
    seen, is_wrong = sfmcpp.add_outliers(scene, 0.3, seed=0)
    measured = measured_of(seen)
    wrong = is_wrong[np.lexsort((seen.point_index, seen.camera_index))]
    plausible = plausible_observations(measured, pair_geometries(measured, 2.0, 0))
    assert plausible[~wrong].mean() > 0.98
    assert plausible[wrong].mean() < 0.05
