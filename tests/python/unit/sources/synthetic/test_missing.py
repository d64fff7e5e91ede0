"""Observations taken away: as many as asked for, in the pattern asked for."""

from __future__ import annotations

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


def test_bad_arguments_are_named() -> None:
    scene = sfmcpp.circle_scene(4, 20)
    with pytest.raises(InvalidArgument, match="pattern"):
        hide_observations(scene, 0.5, pattern="diagonal", seed=0)
    with pytest.raises(InvalidArgument, match="share"):
        hide_observations(scene, 1.5, seed=0)
