"""Looking only at near points finds exactly what looking at all points would find."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sfmcpp.geometry import so3
from sfmcpp.sources.synthetic.image_geometry import ImageGeometry
from sfmcpp.sources.synthetic.observation import observe
from sfmcpp.sources.synthetic.sight import Sight, SpatialGrid


def random_cameras(rng: np.random.Generator, count: int) -> NDArray[np.float64]:
    rotations = so3.exp(rng.uniform(-3, 3, (count, 3)))
    return np.concatenate([rotations, rng.uniform(-30, 30, (count, 3, 1))], axis=2)


def depths_and_pixels(
    cameras: NDArray[np.float64], points: NDArray[np.float64], focal_px: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Of every point in every camera: (C, N) and (C, N, 2), by 4×4 matrices."""
    depths, pixels = [], []
    for camera in cameras:
        x, y, z = (np.linalg.inv(np.vstack([camera, [0, 0, 0, 1]])) @ np.c_[points, np.ones(len(points))].T)[
            :3
        ]
        depths.append(z)
        pixels.append(focal_px * np.stack([x / z, y / z], axis=1))
    return np.array(depths), np.array(pixels)


@pytest.mark.parametrize("focal_px", [150.0, 300.0, 1500.0])  # wide: corners beyond 45°; narrow
@pytest.mark.parametrize("spread", [0.0, 2.0])
def test_exactly_the_points_within_their_depth_and_the_image_are_observed(
    focal_px: float, spread: float
) -> None:
    rng = np.random.default_rng(2)
    cameras, points = random_cameras(rng, 15), rng.uniform(-40, 40, (12_000, 3))
    max_depth_m = 12 * np.exp(spread * rng.uniform(0, 1, 12_000))
    geometry = ImageGeometry("bal", focal_px, (640, 480))
    problem = observe(geometry, cameras, points, 0.0, rng, Sight(max_depth_m))
    depths, pixels = depths_and_pixels(cameras, points, focal_px)
    expected = (depths > 0) & (depths <= max_depth_m) & (np.abs(pixels) <= [320, 240]).all(axis=-1)
    observed = np.zeros_like(expected)
    observed[problem.camera_index, problem.point_index] = True
    np.testing.assert_array_equal(observed, expected)
    assert expected.sum() > 10


def test_what_is_hidden_is_not_observed() -> None:
    rng = np.random.default_rng(3)
    cameras, points = random_cameras(rng, 10), rng.uniform(-40, 40, (2000, 3))
    geometry = ImageGeometry("bal", 300.0, (640, 480))

    def hides(centre: NDArray[np.float64], seen: NDArray[np.float64]) -> NDArray[np.bool_]:
        return np.asarray((seen[:, 2] > 0) != (centre[2] > 0))

    open_, walled = (
        observe(geometry, cameras, points, 0.0, rng, Sight(30.0, hidden)) for hidden in (None, hides)
    )
    same_side = (open_.points[open_.point_index, 2] > 0) == (open_.centres[open_.camera_index, 2] > 0)
    assert 0 < same_side.sum() < len(same_side)
    np.testing.assert_array_equal(walled.point_index, open_.point_index[same_side])
    np.testing.assert_array_equal(walled.camera_index, open_.camera_index[same_side])


@pytest.mark.parametrize("cell_m", [0.3, 1.0, 50.0])
def test_the_grid_finds_all_near_points_and_none_beyond_the_neighbouring_cells(cell_m: float) -> None:
    rng = np.random.default_rng(4)
    points = rng.normal(size=(500, 3)) * [5, 3, 0.5]
    grid = SpatialGrid(points, cell_m)
    for place in rng.normal(size=(50, 3)) * [7, 4, 1]:
        found = grid.near(place)
        assert len(set(found)) == len(found)
        assert set(np.flatnonzero(np.linalg.norm(points - place, axis=1) <= cell_m)) <= set(found)
        assert (np.abs(points[found] - place) <= 2 * cell_m * (1 + 1e-12)).all()


def test_the_grid_is_no_larger_for_points_that_are_far_apart() -> None:
    points = np.array([[0.0, 0.0, 0.0], [1e9, -1e9, 1e9]])
    grid = SpatialGrid(points, 1e-3)
    assert grid.near(points[0]).tolist() == [0]
    assert grid.near(points[1]).tolist() == [1]
