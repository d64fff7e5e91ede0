"""Weights and conflicts are drawn over time, sensor by sensor; those of groups with what was tried."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.axes import Axes

import sfmcpp
from sfmcpp.slam import KeyframeRecord
from sfmcpp.study.plotting.weights import plot_group_weights, plot_weights
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


def test_each_group_has_its_curves_and_its_choice() -> None:
    problem = sfmcpp.circle_scene(8, 80, pixel_sigma_px=1.0, seed=0)
    cameras = np.arange(problem.num_cameras)
    measured = problem.centres + np.random.default_rng(0).normal(0, 0.05, problem.centres.shape)
    selections = []
    for method in ("loo-approx", "l-curve", "variance"):
        group = sfmcpp.ConstraintGroup("position", cameras, measured, name=f"{method} $^{{$")
        selections += sfmcpp.solve(problem.copy(), constraints=[group], weight=method).group_weights
    figure = plot_group_weights(selections)
    figure.canvas.draw()
    assert len(figure.axes) == 6
    for selection, errors, scores in zip(selections, figure.axes[::2], figure.axes[1::2], strict=True):
        curve, choice = errors.get_lines()
        at = selection.weights == selection.weight
        np.testing.assert_allclose(curve.get_xdata(), np.sqrt(selection.constraint_error))
        np.testing.assert_allclose(choice.get_ydata(), np.sqrt(selection.vision[at]))
        drawn = scores.get_lines()[0]
        np.testing.assert_allclose(drawn.get_xdata(), selection.weights[selection.weights > 0])
        assert selection.method in scores.get_ylabel()
        assert f"{selection.weight:.3g}" in scores.get_title()


def test_no_weights_are_refused() -> None:
    with pytest.raises(sfmcpp.InvalidArgument, match="there are none; a solve with weight="):
        plot_group_weights([])
