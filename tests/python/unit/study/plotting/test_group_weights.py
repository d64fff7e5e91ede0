"""The picture of group weights shows what was tried and what was chosen."""

from __future__ import annotations

import numpy as np
import pytest

import sfmcpp
from sfmcpp.study.plotting import plot_group_weights


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
