"""Slow slips of an odometer beside steps of a map whose scale drifts."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import SensorStream
from sfmcpp.sensors import Slip, find_slip, is_easier_without, travelled_distance, without_slip

STAMPS_S = np.arange(0.0, 12.1, 0.3)
MIDDLES_S = 0.5 * (STAMPS_S[1:] + STAMPS_S[:-1])
SLIP = Slip(3.0, 6.0, float(np.log(0.8)), 0.0)
NOISE = 0.03


def covariance(drift: np.ndarray | float = 0.015) -> np.ndarray:
    """Of a scale that walks at random by `drift` from step to step, and an odometer's noise."""
    walk = np.cumsum(np.broadcast_to(drift, MIDDLES_S.shape) ** 2)
    return np.minimum(walk[:, None], walk) + NOISE**2 * np.eye(len(MIDDLES_S))


def ratios(slip: Slip | None, seed: int, drift: np.ndarray | float = 0.015) -> np.ndarray:
    """Steps by the images, in a unit of theirs, over those by the odometer."""
    noise = np.linalg.cholesky(covariance(drift)) @ np.random.default_rng(seed).normal(size=len(MIDDLES_S))
    return 0.7 + noise - (0.0 if slip is None else slip.mean_log_factors(STAMPS_S))


@pytest.mark.parametrize("factor", [0.6, 1.4])
@pytest.mark.parametrize("seed", range(5))
def test_a_slip_that_images_deny_is_found_with_its_factor(factor: float, seed: int) -> None:
    true = Slip(3.0, 6.0, float(np.log(factor)), 0.0)
    found = find_slip(STAMPS_S, ratios(true, seed), covariance())
    assert found is not None
    assert found.log_factor == pytest.approx(np.log(factor), abs=4 * found.sigma)
    assert found.log_factors(MIDDLES_S) == pytest.approx(true.log_factors(MIDDLES_S), abs=0.15)
    assert f"up to {np.exp(found.log_factor):.2f}" in found.complaint


def test_long_steps_have_the_mean_of_the_factor() -> None:
    stamps_s = np.array([2.0, 4.0, 4.7, 8.0])
    means = [SLIP.log_factors(np.linspace(a, b, 2001)).mean() for a, b in pairwise(stamps_s)]
    np.testing.assert_allclose(SLIP.mean_log_factors(stamps_s), means, atol=1e-4)


@pytest.mark.parametrize("seen", [slice(13, None), slice(0, 18), slice(11, 20)])
@pytest.mark.parametrize("seed", range(3))
def test_a_slip_is_found_by_a_map_that_begins_or_ends_within_it(seen: slice, seed: int) -> None:
    true = Slip(3.0, 6.0, float(np.log(0.6)), 0.0)
    steps = slice(seen.start, None if seen.stop is None else seen.stop - 1)
    found = find_slip(STAMPS_S[seen], ratios(true, seed)[steps], covariance()[steps, steps])
    assert found is not None
    within = found.log_factors(MIDDLES_S[steps])
    assert within == pytest.approx(true.log_factors(MIDDLES_S[steps]), abs=0.25)


def test_no_drift_is_taken_for_one() -> None:
    for length in (len(STAMPS_S), 12):
        cut = slice(0, length - 1)
        found = [
            find_slip(STAMPS_S[:length], ratios(None, seed)[cut], covariance()[cut, cut])
            for seed in range(100)
        ]
        assert not any(found)


def test_images_that_do_not_hold_their_scale_blame_nobody() -> None:
    assert find_slip(STAMPS_S, ratios(SLIP, 0), covariance(0.15)) is None
    # They lose it at one keyframe, by half.
    weak = np.full(len(MIDDLES_S), 0.015)
    weak[15] = 0.5
    lost = ratios(None, 0) + 0.5 * (MIDDLES_S[14] < MIDDLES_S)
    assert find_slip(STAMPS_S, lost, covariance(weak)) is None


def test_what_is_no_slow_slip_is_none() -> None:
    assert find_slip(STAMPS_S, ratios(Slip(3.0, 6.0, 1.0, 0.0), 0), covariance()) is None
    exact = 0.7 - Slip(3.0, 6.0, 0.04, 0.0).mean_log_factors(STAMPS_S)
    assert find_slip(STAMPS_S, exact, covariance(1e-4) / 100) is None
    assert find_slip(STAMPS_S, 3 * exact, covariance(1e-4) / 100) is not None


def test_where_the_ratios_scatter_by_more_than_they_should_nothing_is_found() -> None:
    scatter = 0.3 * np.random.default_rng(1).normal(size=len(MIDDLES_S))
    assert find_slip(STAMPS_S, ratios(SLIP, 0) + scatter, covariance()) is None


def test_steps_that_the_odometer_does_not_measure_are_left_out() -> None:
    gaps = ratios(Slip(3.0, 6.0, -0.5, 0.0), 0)
    gaps[[2, 12, 30]] = np.nan
    found = find_slip(STAMPS_S, gaps, covariance())
    assert found is not None
    assert found.log_factor == pytest.approx(-0.5, abs=0.15)
    assert find_slip(STAMPS_S, np.full_like(gaps, np.nan), covariance()) is None
    assert find_slip(STAMPS_S[:3], gaps[:2], covariance()[:2, :2]) is None
    # All within a second.
    assert find_slip(STAMPS_S / 12, ratios(SLIP, 0), covariance()) is None


@pytest.mark.parametrize("kind", ["speed", "velocity", "distance"])
def test_without_it_distances_are_the_true_ones(kind: str) -> None:
    t_s = np.arange(0.0, 12.01, 0.02)
    slipping_m_s = 5.0 * np.exp(SLIP.log_factors(t_s))
    speeds = SensorStream(t_s, slipping_m_s[:, None], "speed")
    ways = [0.0, *(travelled_distance(speeds, 0.0, t) for t in t_s[1:])]
    values = {
        "speed": slipping_m_s[:, None],
        "velocity": np.outer(slipping_m_s, [0.6, 0.0, 0.8]),
        "distance": np.array(ways, dtype=np.float64)[:, None],
    }
    mended = without_slip(SensorStream(t_s, values[kind], kind), SLIP)  # type: ignore[arg-type]
    assert travelled_distance(mended, 0.0, 12.0) == pytest.approx(60.0, rel=1e-4)
    assert travelled_distance(mended, 4.0, 5.0) == pytest.approx(5.0, rel=1e-3)


@pytest.mark.parametrize("factor", [0.7, 1.4])
def test_a_slip_shows_in_the_speed_and_a_scale_that_images_lose_does_not(factor: float) -> None:
    t_s = np.arange(0.0, 12.01, 0.1)
    even_m_s = 10.0 + 0.3 * t_s
    seen = Slip(3.2, 5.9, float(np.log(factor)), 0.0)
    slipping = SensorStream(
        t_s, (even_m_s * np.exp(Slip(3.0, 6.0, seen.log_factor, 0.0).log_factors(t_s)))[:, None], "speed"
    )
    assert is_easier_without(slipping, seen)
    assert not is_easier_without(SensorStream(t_s, even_m_s[:, None], "speed"), seen)
    ways = np.cumsum(even_m_s)[:, None] / 10
    assert not is_easier_without(SensorStream(t_s, ways, "distance"), seen)


def test_lengths_must_fit() -> None:
    with pytest.raises(InvalidArgument, match=r"n \+ 1, n and \(n, n\)"):
        find_slip(STAMPS_S, ratios(SLIP, 0)[1:], covariance())
    with pytest.raises(InvalidArgument, match="kind"):
        without_slip(SensorStream(STAMPS_S, np.zeros((len(STAMPS_S), 3)), "angular_rate"), SLIP)
