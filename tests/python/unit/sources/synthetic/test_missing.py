"""Observations taken away: as many as asked for, in the pattern asked for."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import sfmcpp
from sfmcpp.errors import InvalidArgument
from sfmcpp.sources.synthetic import hide_observations


@pytest.mark.parametrize("pattern", ["runs", "scattered"])
@pytest.mark.parametrize("share", [0.2, 0.5, 0.8])
def test_the_share_asked_for_is_missing(pattern: str, share: float) -> None:
    scene = sfmcpp.circle_scene(20, 400)
    left = hide_observations(scene, share, pattern=pattern, seed=0)
    assert left.num_observations / scene.num_observations == pytest.approx(1 - share, abs=0.02)


def test_runs_are_of_cameras_that_follow_each_other() -> None:
    left = hide_observations(sfmcpp.circle_scene(20, 100), 0.7, pattern="runs", seed=3)
    seen = np.zeros((left.num_points, 20), np.bool_)
    seen[left.point_index, left.camera_index] = True
    # Round the circle each point comes into sight once.
    assert ((seen & ~np.roll(seen, 1, axis=1)).sum(axis=1) == 1).all()
    assert (seen.sum(axis=1) <= 6).all()


def test_what_is_left_is_as_it_was() -> None:
    scene = sfmcpp.circle_scene(10, 50)
    left = hide_observations(scene, 0.4, pattern="scattered", seed=1)
    place = {tuple(pixel): row for row, pixel in enumerate(scene.pixels.tolist())}
    rows = [place[tuple(pixel)] for pixel in left.pixels.tolist()]
    np.testing.assert_array_equal(scene.camera_index[rows], left.camera_index)
    np.testing.assert_array_equal(scene.points[scene.point_index[rows]], left.points[left.point_index])
    assert (np.bincount(left.point_index) >= 2).all()


def test_what_belongs_to_cameras_points_and_observations_goes_with_them() -> None:
    scene = sfmcpp.circle_scene(6, 50)
    scene.metadata.point_colors = np.arange(150, dtype=np.uint8).reshape(50, 3)
    full = replace(
        scene,
        intrinsics=np.stack([scene.intrinsics[0] * factor for factor in (1.0, 2.0)]),
        intrinsics_index=np.array([1, 0, 1, 0, 1, 0], np.int32),
        fixed_intrinsics=None,
        sigma_px=np.arange(1.0, scene.num_observations + 1),
        fixed_cameras=np.arange(6) == 2,
        fixed_points=np.arange(50) % 3 == 0,
    )
    left = hide_observations(full, 0.7, pattern="scattered", seed=1)
    assert left.num_points < 50
    place = {tuple(point): row for row, point in enumerate(full.points.tolist())}
    points = [place[tuple(point)] for point in left.points.tolist()]
    place = {tuple(pixel): row for row, pixel in enumerate(full.pixels.tolist())}
    views = [place[tuple(pixel)] for pixel in left.pixels.tolist()]
    np.testing.assert_array_equal(left.intrinsics, full.intrinsics)
    np.testing.assert_array_equal(left.intrinsics_index, full.intrinsics_index)
    np.testing.assert_array_equal(left.sigma_px, full.sigma_px[views])
    np.testing.assert_array_equal(left.fixed_cameras, full.fixed_cameras)
    np.testing.assert_array_equal(left.fixed_points, full.fixed_points[points])
    np.testing.assert_array_equal(left.metadata.point_colors, full.metadata.point_colors[points])


def test_bad_arguments_are_named() -> None:
    scene = sfmcpp.circle_scene(4, 20)
    with pytest.raises(InvalidArgument, match="pattern"):
        hide_observations(scene, 0.5, pattern="diagonal", seed=0)
    with pytest.raises(InvalidArgument, match="share"):
        hide_observations(scene, 1.5, seed=0)
