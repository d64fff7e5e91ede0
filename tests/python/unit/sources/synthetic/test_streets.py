"""Houses hide what a fine sampling of the line of sight says they hide, and the street loop closes."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from sfmcpp import Problem
from sfmcpp.sources.synthetic import street_loop_scene
from sfmcpp.sources.synthetic.streets import StreetGrid

GRID = StreetGrid((50.0, 30.0), 10.0)


def is_in_house(places: NDArray[np.float64], grid: StreetGrid) -> NDArray[np.bool_]:
    """Whether places (..., 2 or 3) are off every street, by their distance from the nearest axes."""
    pitch = np.array(grid.pitch_m)
    from_axis = np.abs(places[..., :2] - pitch * np.round(places[..., :2] / pitch))
    return (from_axis > grid.street_m / 2).all(axis=-1)


def length_in_houses(
    start: NDArray[np.float64], ends: NDArray[np.float64], grid: StreetGrid
) -> NDArray[np.float64]:
    """Length of the horizontal lines of sight inside houses [m], to about 1 % of their length."""
    shares = (np.arange(2000) + 0.5) / 2000
    inside = is_in_house(start + shares[:, None, None] * (ends - start), grid).mean(axis=0)
    lengths: NDArray[np.float64] = inside * np.linalg.norm((ends - start)[:, :2], axis=1)
    return lengths


@pytest.mark.parametrize("start", [(0.0, 12.0, 2.0), (2.5, -3.0, 2.0), (-71.0, 61.0, 2.0), (50.0, 30.0, 2.0)])
def test_a_point_is_hidden_exactly_if_its_line_of_sight_passes_through_a_house(
    start: tuple[float, float, float],
) -> None:
    rng = np.random.default_rng(1)
    ends = np.array(start) + rng.uniform(-120, 120, (600, 3)) * [1, 1, 0.05]
    hidden = GRID.hides(np.array(start), ends)
    inside_m = length_in_houses(np.array(start), ends, GRID)
    # What grazes a corner for less than the sampling sees is left out.
    clear = (inside_m == 0) | (inside_m > 0.5)
    np.testing.assert_array_equal(hidden[clear], (inside_m > 0)[clear])
    assert clear.mean() > 0.9
    assert 20 < hidden[clear].sum() < clear.sum() - 20


def test_a_view_along_the_axis_of_a_street_is_free_and_across_a_block_is_not() -> None:
    points = np.array([[0.0, 300.0, 5.0], [200.0, 0.0, 5.0], [40.0, 15.0, 5.0], [0.0, 15.0, 5.0]])
    hidden = GRID.hides(np.array([0.0, 0.0, 2.0]), points)
    np.testing.assert_array_equal(hidden, [False, False, True, False])


@pytest.fixture(scope="module")
def loop() -> Problem:
    return street_loop_scene(pixel_sigma_px=0.0, seed=3)


def points_of(problem: Problem, cameras: list[int]) -> set[int]:
    return set(problem.point_index[np.isin(problem.camera_index, cameras)])


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, -90.0, 180.0])
def test_the_last_cameras_see_points_of_the_first(yaw_deg: float) -> None:
    problem = street_loop_scene(yaw_deg=yaw_deg)
    last, middle = problem.num_cameras - 1, problem.num_cameras // 2
    assert len(points_of(problem, [last]) & points_of(problem, [0])) >= 50
    assert not points_of(problem, [middle]) & points_of(problem, [0])


def test_the_vehicle_drives_once_around_the_block_on_the_axes_of_the_streets(loop: Problem) -> None:
    x, y, height = loop.centres.T
    on_axis = [np.isclose(y, 0), np.isclose(x, 100), np.isclose(y, 60), np.isclose(x, 0)]
    assert np.any(on_axis, axis=0).all()
    assert ((x >= 0) & (x <= 100) & (y >= 0) & (y <= 60)).all()
    np.testing.assert_allclose(height, height[0])
    steps = np.linalg.norm(np.roll(loop.centres, -1, axis=0) - loop.centres, axis=1)
    np.testing.assert_allclose(np.sort(steps)[4:], 2.0)  # but for the four steps around a corner
    area = 0.5 * np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))
    assert 5900 < area <= 6000  # counterclockwise


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, -90.0])
def test_cameras_look_to_the_left_of_the_way_by_the_yaw(yaw_deg: float) -> None:
    problem = street_loop_scene(yaw_deg=yaw_deg)
    # The first camera is in the middle of the first street, which runs along x.
    expected = [np.cos(np.deg2rad(yaw_deg)), np.sin(np.deg2rad(yaw_deg)), 0]
    np.testing.assert_allclose(problem.rotations[0, :, 2], expected, atol=1e-15)


def test_points_stand_on_fronts_on_both_sides_of_the_streets(loop: Problem) -> None:
    centred = np.abs(loop.points[:, :2] - [50, 30])
    beyond_inner = (centred - [43, 23]).max(axis=1)
    beyond_outer = (centred - [57, 37]).max(axis=1)
    is_inner = (beyond_inner >= -1e-9) & (beyond_inner <= 0.5 + 1e-9)
    is_outer = (beyond_outer >= -0.5 - 1e-9) & (beyond_outer <= 1e-9)
    assert (is_inner ^ is_outer).all()
    assert 0.4 < is_inner.mean() < 0.6
    assert loop.points[:, 2].min() >= 0


def test_no_camera_sees_through_the_block_or_beyond_the_greatest_depth(loop: Problem) -> None:
    starts, ends = loop.centres[loop.camera_index], loop.points[loop.point_index]
    depths = np.einsum("mi,mi->m", ends - starts, loop.rotations[loop.camera_index, :, 2])
    assert 38 < depths.max() <= 40
    for share in np.linspace(0, 1, 101):
        inside = np.abs((starts + share * (ends - starts))[:, :2] - [50, 30]) < [43 - 1e-6, 23 - 1e-6]
        assert not inside.all(axis=1).any()
