"""Weights and conflicts are drawn over time, sensor by sensor."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from sfmcpp.slam import KeyframeRecord
from sfmcpp.study.plotting.weights import plot_weights
from sfmcpp.weighting.conflict import CONFLICT_SIGMAS


def record(t_s: float, weights: dict[str, float], conflicts: dict[str, float]) -> KeyframeRecord:
    return KeyframeRecord(0, t_s, 0, 0, {}, weights, conflicts)


RECORDS = [
    record(10.0, {}, {}),
    record(10.5, {"odometer": 2.0, "imu": 0.1}, {"odometer": 0.5}),
    record(11.5, {"odometer": 0.0}, {"odometer": 7.0}),
    record(12.0, {"odometer": 4.0, "imu": 0.2}, {}),
]


def points_of(axes: Axes, marker: str) -> list[list[list[float]]]:
    return [np.asarray(line.get_xydata()).tolist() for line in axes.lines if line.get_marker() == marker]


def test_each_sensor_has_a_curve_over_the_seconds_since_the_first_keyframe() -> None:
    weights, conflicts = plot_weights(RECORDS).axes
    assert points_of(weights, ".") == [[[0.5, 0.1], [2.0, 0.2]], [[0.5, 2.0], [2.0, 4.0]]]
    assert points_of(conflicts, ".") == [[], [[0.5, 0.5], [1.5, 7.0]]]
    legend = weights.get_legend()
    assert legend is not None
    assert [text.get_text() for text in legend.get_texts()] == ["imu", "odometer"]
    assert weights.get_yscale() == "log"


def test_seconds_count_from_the_first_keyframe_also_where_it_has_no_record() -> None:
    weights = plot_weights(RECORDS, start_s=9.0).axes[0]
    assert points_of(weights, ".") == [[[1.5, 0.1], [3.0, 0.2]], [[1.5, 2.0], [3.0, 4.0]]]


def test_weights_of_zero_are_crosses_at_the_bottom() -> None:
    weights = plot_weights(RECORDS).axes[0]
    assert points_of(weights, "x") == [[], [[1.5, 0.02]]]


def test_a_run_without_sensors_is_drawn_empty() -> None:
    weights, conflicts = plot_weights([record(1.0, {}, {})]).axes
    assert points_of(weights, ".") == points_of(conflicts, ".") == []


def test_the_line_of_significance_is_in_view_where_all_agree() -> None:
    conflicts = plot_weights([record(1.0, {"imu": 0.1}, {"imu": 0.4})]).axes[1]
    low, high = conflicts.get_ylim()
    assert (low, high > CONFLICT_SIGMAS) == (0.0, True)
