"""WGS 84 against facts of the ellipsoid that do not come from the formulas used."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from sfmcpp.errors import InvalidArgument
from sfmcpp.sensors import (
    SensorStream,
    earth_centred,
    east_north_up,
    geodetic_of,
    local_positions,
    measured_at,
    position_at,
    smoothed_positions,
)
from sfmcpp.sensors.gps import FLATTENING, SEMI_MAJOR_AXIS_M, doubt_of_radians, middle_of, position_sigma

SEMI_MINOR_AXIS_M = 6_356_752.314245  # NIMA TR8350.2, table 3.3


def random_places(count: int) -> np.ndarray:
    rng = np.random.default_rng(3)
    return np.stack(
        [rng.uniform(-90, 90, count), rng.uniform(-180, 180, count), rng.uniform(-100, 5000, count)], axis=1
    )


def test_height_is_measured_along_the_normal_of_the_ellipsoid() -> None:
    places = random_places(50)
    ground = earth_centred(places * [1, 1, 0])
    axes = np.array([SEMI_MAJOR_AXIS_M, SEMI_MAJOR_AXIS_M, SEMI_MINOR_AXIS_M])
    np.testing.assert_allclose(np.sum((ground / axes) ** 2, axis=1), 1.0, rtol=1e-12)
    normal = ground / axes**2
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    np.testing.assert_allclose(earth_centred(places), ground + places[:, 2:] * normal, atol=1e-4)
    np.testing.assert_allclose(np.rad2deg(np.arcsin(normal[:, 2])), places[:, 0], atol=1e-9)


def test_the_equator_and_a_pole_are_where_the_axes_end() -> None:
    found = earth_centred([[0, 0, 0], [0, 90, 0], [90, 0, 0]])
    expected = np.diag([SEMI_MAJOR_AXIS_M, SEMI_MAJOR_AXIS_M, SEMI_MINOR_AXIS_M])
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_walk_along_the_meridian_is_as_long_as_its_arc() -> None:
    """The quarter meridian is 10,001,965.729 m."""
    eccentricity_squared = 1 - (SEMI_MINOR_AXIS_M / SEMI_MAJOR_AXIS_M) ** 2
    quarter, _ = quad(
        lambda b: np.sqrt((SEMI_MAJOR_AXIS_M * np.sin(b)) ** 2 + (SEMI_MINOR_AXIS_M * np.cos(b)) ** 2),
        0,
        np.pi / 2,
    )
    latitudes = np.linspace(0, 90, 20_001)
    path = earth_centred(np.stack([latitudes, 0 * latitudes + 8.4, 0 * latitudes], axis=1))
    walked = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
    assert walked == pytest.approx(quarter, abs=0.01)
    assert walked == pytest.approx(10_001_965.729, abs=0.01)
    assert eccentricity_squared == pytest.approx(FLATTENING * (2 - FLATTENING), rel=1e-12)


def test_local_axes_point_east_north_and_up() -> None:
    origin = [49.011, 8.4228, 116.4]
    steps = np.array([origin] * 4) + np.array([[0, 1e-5, 0], [1e-5, 0, 0], [0, 0, 1], [0, 0, 0]])
    found = east_north_up(steps, origin)
    lengths = np.linalg.norm(found, axis=1)
    assert lengths[:3] == pytest.approx([0.7316, 1.1121, 1.0], abs=2e-4)
    np.testing.assert_allclose(found[:3] / lengths[:3, None], np.eye(3)[[0, 1, 2]], atol=1e-6)
    np.testing.assert_allclose(found[3], 0, atol=1e-9)


@pytest.mark.parametrize("latitude", [-89.9, -33.0, 0.0, 46.5, 90.0])
@pytest.mark.parametrize("height", [-100.0, 0.0, 9000.0])
def test_geodetic_of_is_east_north_up_backwards(latitude: float, height: float) -> None:
    origin = np.array([latitude, 179.99, height])
    local = np.random.default_rng(0).normal(0, 5000, (20, 3))
    there = geodetic_of(local, origin)
    assert (np.abs(there[:, 1]) <= 180).all()
    np.testing.assert_allclose(east_north_up(there, origin), local, atol=1e-7)
    np.testing.assert_allclose(geodetic_of(np.zeros((1, 3)), origin)[0, [0, 2]], origin[[0, 2]], atol=1e-7)


def test_local_positions_keep_the_distances() -> None:
    places = np.array([[49.0, 8.0, 100.0], [49.001, 8.002, 130.0], [48.999, 8.001, 90.0]])
    local = local_positions(SensorStream(10 * np.arange(3.0), places, "geodetic", "gps")).values
    exact = earth_centred(places)
    for i, j in [(0, 1), (1, 2), (0, 2)]:
        ours = np.linalg.norm(local[i] - local[j])
        assert ours == pytest.approx(np.linalg.norm(exact[i] - exact[j]), abs=1e-6)


def test_positions_between_fixes_lie_on_the_line_and_go_on_after_the_last() -> None:
    stream = SensorStream(np.arange(3.0), np.array([[0, 0, 0], [10, 0, 0], [10, 20, 0.0]]), "position")
    np.testing.assert_allclose(position_at(stream, 1.25), [10, 5, 0])
    np.testing.assert_allclose(position_at(stream, 2.5), [10, 30, 0])
    assert position_at(stream, 8.0) is None


def test_positions_between_fixes_far_apart_and_beyond_them_are_less_certain() -> None:
    stream = SensorStream(np.array([0.0, 0.1, 0.2, 4.2]), np.zeros((4, 3)), "position", max_gap_s=5.0)
    assert position_sigma(stream, 0.05, 1.0) == pytest.approx(1.0, abs=1e-5)
    # Four seconds of a straight line beside one bent by 1 m/s².
    assert position_sigma(stream, 2.2, 1.0) == pytest.approx(np.hypot(1.0, 2.0))
    # The velocity of the first two positions, for two seconds before them.
    assert position_sigma(stream, -2.0, 1.0) == pytest.approx(np.hypot(np.hypot(20, 21), 2.1))
    assert position_sigma(stream, 2.2, None) is None
    assert position_sigma(stream.only(stream.t_s < 0.1), 0.5, 1.0) == 1.0


def test_the_180th_meridian_is_a_place_like_any_other() -> None:
    longitudes = np.array([179.99, 179.997, -179.996, -179.99])
    places = np.column_stack([np.full(4, -16.8), longitudes, np.zeros(4)])
    middle = middle_of(places)
    assert abs(middle[1]) > 179.98
    assert np.abs(east_north_up(places, middle)).max() < 2000
    stream = SensorStream(np.arange(4.0), places, "geodetic")
    between = measured_at(stream, np.arange(0.0, 3.0, 0.1))
    assert np.abs(east_north_up(between, middle)).max() < 2000
    np.testing.assert_array_equal(middle_of(places * [1, 0, 1]), [-16.8, 0, 0])


def test_a_latitude_beyond_the_pole_is_refused() -> None:
    with pytest.raises(InvalidArgument, match=r"geodetic\[1\]: latitude 91.0°"):
        earth_centred([[0, 0, 0], [91, 0, 0]])


def test_smoothing_halves_white_noise_of_ten_positions_a_second_and_keeps_a_parabola() -> None:
    t_s = np.arange(0.0, 40.0, 0.1)
    way = np.stack([4e5 + 8 * t_s, 5e6 + 0.5 * t_s**2, 300 + 0 * t_s], axis=1)
    np.testing.assert_allclose(smoothed_positions(SensorStream(t_s, way, "position")).values, way, atol=1e-6)
    noise = np.random.default_rng(0).normal(size=way.shape)
    smooth = smoothed_positions(SensorStream(t_s, way + noise, "position")).values - way
    in_the_middle = np.sqrt(3 * (3 * 11**2 - 7) / (4 * 11 * (11**2 - 4)))  # of 11 places, one apart
    assert smooth[10:-10].std() == pytest.approx(in_the_middle, rel=0.1)
    assert smooth.std() < 0.55


@pytest.mark.parametrize("rate_hz", [5, 6, 10, 18, 25])
@pytest.mark.parametrize("start_s", [100.123, 1.7e9])
def test_positions_are_smoothed_alike_whatever_the_clock_is(start_s: float, rate_hz: int) -> None:
    t_s = np.arange(20 * rate_hz) / rate_hz
    way = np.outer(t_s, [8.0, 1.0, 0.0]) + 0.3 * np.random.default_rng(0).normal(size=(len(t_s), 3))
    from_zero, later = (
        smoothed_positions(SensorStream(t, way, "position"), 0.5).values for t in (t_s, start_s + t_s)
    )
    np.testing.assert_allclose(later, from_zero, atol=1e-5)


def test_exact_positions_at_a_corner_are_left_alone() -> None:
    t_s = np.arange(0.0, 10.0, 0.1)
    corner = np.stack([8 * np.minimum(t_s, 5), 8 * np.maximum(t_s - 5, 0), 0 * t_s], axis=1)
    kept = smoothed_positions(SensorStream(t_s, corner, "position"), 0.02).values
    np.testing.assert_allclose(kept, corner, atol=0.02)
    assert np.abs(smoothed_positions(SensorStream(t_s, corner, "position"), 1.0).values - corner).max() > 0.3


def test_smoothing_does_not_reach_over_gaps_and_leaves_sparse_positions_alone() -> None:
    t_s = np.concatenate([np.arange(0.0, 3.0, 0.1), np.arange(10.0, 13.0, 0.1)])
    way = np.where(t_s[:, None] < 5, 0.0, 100.0) + np.zeros(3)
    np.testing.assert_array_equal(smoothed_positions(SensorStream(t_s, way, "position")).values, way)
    sparse = SensorStream(np.arange(20.0), np.random.default_rng(1).normal(size=(20, 3)), "position")
    np.testing.assert_array_equal(smoothed_positions(sparse).values, sparse.values)


def test_places_of_any_height_may_be_in_radians() -> None:
    origin, places = np.array([0.85, 0.15, 400.0]), np.array([[0.0, 0.0, 0.0], [10.0, 5.0, 5_000.0]])
    assert len(doubt_of_radians(origin, places)) == 1
    assert doubt_of_radians(origin, places[:, [2, 1, 0]]) == []
