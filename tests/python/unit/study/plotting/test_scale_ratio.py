"""Steps of keyframes over true ones, in time, with their running median."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from sfmcpp.model import Trajectory
from sfmcpp.study.evaluation import Matched
from sfmcpp.study.plotting.evaluations import plot_scale_ratio


def along_x(t_s: np.ndarray, x: np.ndarray) -> Trajectory:
    poses = np.tile(np.eye(3, 4), (len(x), 1, 1))
    poses[:, 0, 3] = x
    return Trajectory(t_s, poses)


def drawn(figure: Figure) -> dict[str, np.ndarray]:
    return {str(line.get_label()): np.asarray(line.get_xydata()) for line in figure.axes[0].lines}


def test_each_step_is_drawn_over_the_true_one_where_it_ends() -> None:
    t_s = np.array([5.0, 6.0, 7.0, 9.0])
    estimate = along_x(t_s, np.array([0.0, 1.1, 2.9, 6.9]))
    lines = drawn(plot_scale_ratio(Matched(estimate, along_x(t_s, np.array([0.0, 1.0, 3.0, 7.0])))))
    np.testing.assert_allclose(lines["step between keyframes"], [[1, 1.1], [2, 0.9], [4, 1.0]])
    assert not any("median" in name for name in lines)


def test_steps_of_a_standing_camera_are_left_out() -> None:
    t_s = np.arange(4.0)
    truth = along_x(t_s, np.array([0.0, 1.0, 1.001, 2.0]))
    pairs = Matched(along_x(t_s, np.array([0.0, 0.5, 0.7, 1.2])), truth)
    lines = drawn(plot_scale_ratio(pairs, scaled="aligned"))
    found = lines["step between keyframes, aligned"]
    np.testing.assert_allclose(found, [[1, 0.5], [3, 0.5 / 0.999]])


def test_one_wild_step_does_not_move_the_median() -> None:
    t_s = np.arange(30.0)
    steps = np.full(29, 0.8)
    steps[14] = 3.0
    estimate = along_x(t_s, np.concatenate([[0.0], np.cumsum(steps)]))
    figure = plot_scale_ratio(Matched(estimate, along_x(t_s, t_s)))
    median = drawn(figure)["running median of 11"]
    np.testing.assert_allclose(median[:, 0], np.arange(6.0, 25.0))
    np.testing.assert_allclose(median[:, 1], 0.8)
    low, high = figure.axes[0].get_ylim()
    assert low < 0.8
    assert high > 3.0
    assert f"{steps.mean():.4g}" in figure.axes[0].get_ylabel()


def test_a_single_keyframe_is_drawn_empty() -> None:
    one = along_x(np.zeros(1), np.zeros(1))
    assert drawn(plot_scale_ratio(Matched(one, one)))["step between keyframes"].size == 0


def test_the_uncertainty_of_the_scale_is_a_band_that_opens() -> None:
    t_s = np.arange(20.0)
    pairs = Matched(along_x(t_s, 1.2 * t_s), along_x(t_s, t_s))
    sigmas = 0.01 * t_s
    (band,) = plot_scale_ratio(pairs, sigmas=sigmas).axes[0].collections
    outline = band.get_paths()[0].vertices
    low, high = outline[outline[:, 0] == 19.0][:, 1].min(), outline[outline[:, 0] == 19.0][:, 1].max()
    np.testing.assert_allclose([low, high], 1.2 * np.exp([-0.19, 0.19]))
    assert not plot_scale_ratio(pairs).axes[0].collections
