"""The city: tracks like BAL's at every size, and work that grows no faster than the city."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import sfmcpp
from sfmcpp import Problem
from sfmcpp.sources.synthetic import city_blocks_scene
from sfmcpp.sources.synthetic.image_geometry import ImageGeometry

TRACKS_OF_AT_LEAST = np.array([3, 4, 5, 7, 10, 15])


def shares_of_tracks(problem: Problem) -> NDArray[np.float64]:
    """Share of the points with at least so many observations."""
    lengths = np.bincount(problem.point_index)
    return np.array([np.mean(lengths >= length) for length in TRACKS_OF_AT_LEAST])


@pytest.fixture(scope="module")
def city() -> Problem:
    return city_blocks_scene(1000, seed=1)


def test_a_thousand_cameras_have_tracks_like_bal(city: Problem) -> None:
    lengths = np.bincount(city.point_index)
    assert 4 <= lengths.mean() <= 6
    assert lengths.min() == 2
    assert np.median(lengths) == 3
    assert 40 <= lengths.max() <= 100
    assert 80_000 <= city.num_points <= 100_000
    np.testing.assert_allclose(shares_of_tracks(city), (2 / TRACKS_OF_AT_LEAST) ** 1.45, atol=0.1)


@pytest.mark.real
def test_the_lengths_of_tracks_are_distributed_as_in_bal(data_dir: Path, city: Problem) -> None:
    ladybug = sfmcpp.read(data_dir / "bal" / "problem-49-7776-pre.txt.bz2")
    np.testing.assert_allclose(shares_of_tracks(city), shares_of_tracks(ladybug), atol=0.1)


@pytest.mark.parametrize("num_cameras", [50, 300])
def test_smaller_cities_are_one_part_with_shorter_tracks(num_cameras: int) -> None:
    problem = city_blocks_scene(num_cameras)
    assert sfmcpp.check(problem) == []
    assert 3 <= np.bincount(problem.point_index).mean() <= 5


def test_work_and_observations_grow_in_proportion_to_the_cameras(monkeypatch: pytest.MonkeyPatch) -> None:
    project = ImageGeometry.project
    looked_at: list[int] = []

    def counted(
        self: ImageGeometry,
        camera: NDArray[np.float64],
        points: NDArray[np.float64],
        max_depth_m: float | NDArray[np.float64] = np.inf,
    ) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        looked_at.append(len(points))
        return project(self, camera, points, max_depth_m)

    monkeypatch.setattr(ImageGeometry, "project", counted)
    looked_at_per_camera, seen_per_camera = [], []
    for num_cameras in (800, 3300):  # cities of 4 × 4 and 9 × 9 blocks, driven whole
        looked_at.clear()
        problem = city_blocks_scene(num_cameras, 20 * num_cameras, spacing_m=6.0)
        looked_at_per_camera.append(np.mean(looked_at))
        seen_per_camera.append(problem.num_observations / num_cameras)
    assert seen_per_camera[0] > 50
    assert 0.95 < seen_per_camera[1] / seen_per_camera[0] < 1.05
    # Not constant, for there is less rim to a larger city; 4.1 if cameras looked at every point.
    assert 1.0 < looked_at_per_camera[1] / looked_at_per_camera[0] < 1.5
    assert looked_at_per_camera[1] < 0.03 * problem.num_points


def test_the_vehicle_drives_on_the_axes_at_the_asked_spacing() -> None:
    problem = city_blocks_scene(400, spacing_m=2.5, block_m=80.0)
    x, y, height = problem.centres.T
    on_axis = [np.isclose(v, 80 * np.round(v / 80), atol=1e-9) for v in (x, y)]
    assert np.any(on_axis, axis=0).all()
    np.testing.assert_allclose(height, height[0])
    steps = np.abs(np.diff(problem.centres[:, :2], axis=0)).sum(axis=1)
    np.testing.assert_allclose(steps, 2.5)


def test_a_city_driven_whole_is_driven_on_every_street() -> None:
    # 2 · 3 · (3 + 2) blocks of 100 m: 1,000 images at 3 m leave the last block short.
    problem = city_blocks_scene(990, 1000)
    stretches = {tuple(middle) for middle in np.floor(problem.centres[:, :2] / 50).astype(int)}
    on_rows = {s for s in stretches if s[1] % 2 == 0}
    on_columns = {s for s in stretches if s[0] % 2 == 0}
    assert {(x, 2 * y) for x in range(6) for y in range(4)} <= on_rows
    assert {(2 * x, y) for x in range(4) for y in range(6)} <= on_columns


def test_later_cameras_meet_the_way_of_the_first_ones(city: Problem) -> None:
    first_camera = np.full(city.num_points, city.num_cameras)
    np.minimum.at(first_camera, city.point_index, city.camera_index)
    last_camera = np.zeros(city.num_points, dtype=int)
    np.maximum.at(last_camera, city.point_index, city.camera_index)
    # 400 cameras are 1,200 m of way; nothing is seen farther than 100 m ahead.
    assert np.mean(last_camera - first_camera > 400) > 0.05


def test_no_camera_sees_deeper_than_asked_nor_into_another_street() -> None:
    problem = city_blocks_scene(200, max_depth_m=60.0, pixel_sigma_px=0.0)
    starts, ends = problem.centres[problem.camera_index], problem.points[problem.point_index]
    depths = np.einsum("mi,mi->m", ends - starts, problem.rotations[problem.camera_index, :, 2])
    assert 55 < depths.max() <= 60
    for share in np.linspace(0, 1, 101):
        place = (starts + share * (ends - starts))[:, :2]
        from_axis = np.abs(place - 100 * np.round(place / 100))
        assert not (from_axis > 7 + 1e-6).all(axis=1).any()
