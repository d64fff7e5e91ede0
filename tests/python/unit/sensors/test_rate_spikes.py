"""Spikes of angular rates: found where they are, and only there."""

from __future__ import annotations

import numpy as np
import pytest

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import SensorStream
from sfmcpp.sensors import describe_spikes, rate_spikes, without_spikes

T_S = 0.1 * np.arange(200)


def rates(noise_deg_s: float = 0.3) -> np.ndarray:
    """A vehicle that winds, 40°/s at most, with noise."""
    smooth = np.zeros((len(T_S), 3))
    smooth[:, 2] = np.radians(40) * np.sin(0.6 * T_S)
    return smooth + np.random.default_rng(2).normal(0, np.radians(noise_deg_s), smooth.shape)


def stream_of(values: np.ndarray) -> SensorStream:
    return SensorStream(T_S, values, "angular_rate", "imu")


@pytest.mark.parametrize("noise_deg_s", [0.0, 0.3, 3.0])
def test_correct_rates_have_none(noise_deg_s: float) -> None:
    assert not rate_spikes(stream_of(rates(noise_deg_s))).any()
    assert describe_spikes(stream_of(rates(noise_deg_s))) == []
    correct = stream_of(rates(noise_deg_s))
    assert without_spikes(correct) is correct


def test_a_bend_that_begins_at_once_is_none() -> None:
    values = rates()
    values[80:, 2] += np.radians(30)
    assert not rate_spikes(stream_of(values)).any()


@pytest.mark.parametrize("rows", [[57], [57, 90, 120], list(range(5, 195, 19))])
def test_samples_that_leap_away_and_back_are_found(rows: list[int]) -> None:
    values = rates()
    values[rows, 1] += np.radians(40)
    stream = stream_of(values)
    assert np.flatnonzero(rate_spikes(stream)).tolist() == rows
    (told,) = describe_spikes(stream)
    assert f"{len(rows)} of 200 rates leap away and back within a sample" in told
    assert f"first at {T_S[rows[0]]:.3f} s" in told
    mended = without_spikes(stream).values
    others = np.setdiff1d(np.arange(200), rows)
    np.testing.assert_array_equal(mended[others], values[others])
    assert np.abs(mended - rates()).max() < np.radians(3)


def test_a_spike_does_not_take_the_place_of_the_next_one() -> None:
    values = rates(0.0)
    values[[57, 58], 1] += np.radians([100, -100])
    stream = stream_of(values)
    assert np.flatnonzero(rate_spikes(stream)).tolist() == [57, 58]
    assert np.abs(without_spikes(stream).values - rates(0.0)).max() < np.radians(3)


def test_neighbours_across_a_gap_tell_nothing() -> None:
    values, kept = rates(), np.r_[0:57, 60:200]
    values[60, 1] += np.radians(40)
    stream = SensorStream(T_S[kept], values[kept], "angular_rate")
    assert not rate_spikes(stream).any()


def test_other_streams_and_short_ones() -> None:
    assert not rate_spikes(SensorStream(T_S[:2], np.zeros((2, 3)), "angular_rate")).any()
    with pytest.raises(InvalidArgument, match="angular_rate"):
        rate_spikes(SensorStream(T_S, np.zeros((200, 1)), "speed"))


@pytest.mark.real
def test_no_rate_of_a_real_drive_is_one(data_dir: object) -> None:
    from pathlib import Path

    from sfmcpp.sources.drives import open_drive

    for drive in sorted((Path(str(data_dir)) / "kitti_tracks").glob("*.mat")):
        (stream,) = open_drive(drive).streams_of(["imu"])
        assert not rate_spikes(stream).any(), drive
