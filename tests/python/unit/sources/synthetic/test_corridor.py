"""The corridor: where its points and cameras are, and how short its tracks."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.sources.synthetic import corridor_scene


def test_points_lie_on_the_walls_the_floor_and_the_ceiling_by_their_areas() -> None:
    points = corridor_scene(width_m=3.0, height_m=2.5, num_points=8000, max_depth_m=20.0).points
    sides = {
        "left": np.isclose(points[:, 1], 1.5),
        "right": np.isclose(points[:, 1], -1.5),
        "floor": np.isclose(points[:, 2], 0.0, atol=1e-12),
        "ceiling": np.isclose(points[:, 2], 2.5),
    }
    assert np.sum(list(sides.values()), axis=0).tolist() == [1] * len(points)
    shares = {name: side.mean() for name, side in sides.items()}
    expected = {"left": 2.5 / 11, "right": 2.5 / 11, "floor": 3 / 11, "ceiling": 3 / 11}
    assert shares == pytest.approx(expected, abs=0.02)
    assert (np.abs(points[:, 1]) <= 1.5).all()


def test_cameras_walk_straight_down_the_middle() -> None:
    problem = corridor_scene(21, length_m=40.0, height_m=2.5)
    expected = np.column_stack([np.linspace(0, 40, 21), np.zeros(21), np.full(21, 1.5)])
    np.testing.assert_allclose(problem.centres, expected)
    np.testing.assert_allclose(problem.rotations[:, :, 2], [[1.0, 0.0, 0.0]] * 21)


@pytest.mark.parametrize("max_depth_m", [5.0, 8.0, 20.0])
def test_the_depth_of_view_bounds_the_tracks(max_depth_m: float) -> None:
    problem = corridor_scene(61, 3000, length_m=60.0, max_depth_m=max_depth_m)
    depth_m = problem.points[problem.point_index, 0] - problem.centres[problem.camera_index, 0]
    assert depth_m.min() > 0
    assert 0.98 * max_depth_m < depth_m.max() <= max_depth_m
    # One camera a metre; a wall comes into view at 1.5 m · 500 px / 320 px = 2.3 m.
    longest = np.bincount(problem.point_index).max()
    assert max_depth_m - 2.4 - 1 <= longest <= max_depth_m - 2.3 + 1


def test_the_ends_of_the_corridor_share_nothing() -> None:
    problem = corridor_scene()
    first, last = (set(problem.point_index[problem.camera_index == c]) for c in (0, 59))
    assert first
    assert last
    assert not first & last
