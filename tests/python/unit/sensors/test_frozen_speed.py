"""Odometers that repeat their last value while the body goes on."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.model.arrays import FloatArray
from sfmcpp.sensors import SensorStream
from sfmcpp.sensors.frozen_speed import frozen_stretches
from sfmcpp.slam.motion_sensors import Odometer
from sfmcpp.slam.sensor_faults import faults_of_streams
from sfmcpp.slam.sensor_suite import SensorSuite

T_S = np.arange(0.0, 40.0, 0.04)


def speeds(sigma_m_s: float = 0.03, seed: int = 0) -> FloatArray:
    """Twice up to 10 m/s and down to a stand."""
    noise = sigma_m_s * np.random.default_rng(seed).standard_normal(len(T_S))
    true = 5.0 - 5.0 * np.cos(2 * np.pi * T_S / 20.0)
    return np.asarray(np.where(true < 0.05, 0.0, true + noise))


def frozen(values: FloatArray, start_s: float, end_s: float) -> FloatArray:
    at = np.searchsorted(T_S, start_s)
    return np.asarray(np.where((start_s <= T_S) & (end_s > T_S), values[at], values))


def stream_of(values: FloatArray, kind: str = "speed") -> SensorStream:
    return SensorStream(T_S, values[:, None] * [[1.0, 0.0, 0.0]] if kind == "velocity" else values, kind)


@pytest.mark.parametrize("kind", ["speed", "velocity"])
@pytest.mark.parametrize("end_s", [5.0, 7.0])
def test_a_frozen_odometer_is_bridged_and_named(kind: str, end_s: float) -> None:
    stream = stream_of(frozen(speeds(), 3.0, end_s), kind)
    (found,) = frozen_stretches(stream)
    assert found.start_s == pytest.approx(3.0)
    assert found.end_s == pytest.approx(end_s)
    odometer = Odometer(stream)
    assert odometer.carried_stretches == (found,)
    true = Odometer(stream_of(speeds(), kind)).between(3.0, end_s)
    told = odometer.between(3.0, end_s)
    assert true is not None
    assert told == pytest.approx(true, rel=0.05)
    (sentence,) = faults_of_streams(SensorSuite([odometer]))
    assert "repeats its last value" in sentence
    assert "bridged by inertia" in sentence


def test_what_follows_a_frozen_stretch_keeps_its_weight() -> None:
    """The leap at its end opened a stretch without weight that lasted to the next stop."""
    odometer = Odometer(stream_of(frozen(speeds(), 3.0, 6.0)))
    assert odometer.between(7.0, 9.0) == pytest.approx(Odometer(stream_of(speeds())).between(7.0, 9.0))


def test_an_odometer_that_is_frozen_to_the_end_gets_no_weight() -> None:
    odometer = Odometer(stream_of(frozen(speeds(), 33.0, 50.0)))
    assert odometer.between(34.0, 36.0) is None
    assert odometer.between(30.0, 32.0) is not None


@pytest.mark.parametrize("step", [0.0, 0.01, 0.1, 1 / 3.6])
@pytest.mark.parametrize("repeated", [1, 5])
@pytest.mark.parametrize("seed", range(4))
def test_speeds_that_were_measured_are_not_frozen(step: float, repeated: int, seed: int) -> None:
    """Of a cruise control and a stand, on a grid or not, logged five times or once."""
    values = np.minimum(speeds(seed=seed), 6.0 + (step == 0.0) * speeds(seed=seed + 9) / 100)
    values = values if step == 0.0 else np.round(values / step) * step
    assert frozen_stretches(stream_of(np.repeat(values[::repeated], repeated)[: len(T_S)])) == ()


def test_speeds_without_noise_may_be_constant() -> None:
    """Up to 6 m/s and on at it, exactly, as some simulators have it."""
    assert frozen_stretches(stream_of(np.minimum(speeds(0.0), 6.0))) == ()
    assert frozen_stretches(stream_of(np.where(T_S < 5.0, speeds(0.0), 5.0))) == ()
