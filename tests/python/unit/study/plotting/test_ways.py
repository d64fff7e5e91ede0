"""The picture of an evaluation: both ways side by side with the errors, whatever their shape."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from sfmcpp.model import Trajectory
from sfmcpp.study.evaluation import evaluate
from sfmcpp.study.plotting import save_figure
from sfmcpp.study.plotting.evaluations import plot_evaluation

ALONG = np.linspace(0.0, 60.0, 40)
WAYS = {
    "straight": np.column_stack([0.01 * ALONG, 0.02 * np.sin(ALONG), ALONG]),
    "round": np.column_stack([np.cos(ALONG / 10), np.sin(ALONG / 10), 0 * ALONG]),
    "wide": np.column_stack([ALONG, 0.1 * np.cos(ALONG), 0 * ALONG]),
}


def picture(centres: np.ndarray) -> Figure:
    poses = np.tile(np.eye(3, 4), (len(centres), 1, 1))
    poses[:, :, 3] = centres
    truth = Trajectory(np.arange(len(poses), dtype=float), poses)
    return plot_evaluation(evaluate(truth, truth))


@pytest.mark.parametrize("name", WAYS)
def test_the_truth_shows_under_an_estimate_that_lies_on_it(name: str, tmp_path: Path) -> None:
    figure = picture(WAYS[name])
    lines = {str(line.get_label()): line for line in figure.axes[0].lines}
    assert lines["ground truth"].get_linewidth() > 2 * lines["estimate"].get_linewidth()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save_figure(figure, tmp_path / "a.png")


@pytest.mark.parametrize("name", WAYS)
def test_the_axes_end_where_the_ways_do(name: str) -> None:
    figure = picture(WAYS[name])
    figure.canvas.draw()
    axes = figure.axes[0]
    extents = [abs(high - low) for low, high in (axes.get_xlim(), axes.get_ylim())]
    assert max(extents) <= 1.5 * np.ptp(WAYS[name], axis=0).max()
    # One unit is as long along both axes, and neither half of the picture is empty.
    box = axes.get_window_extent()
    assert box.width / box.height == pytest.approx(extents[0] / extents[1], rel=0.05)
    assert figure.axes[1].get_window_extent().x0 - box.x1 < 0.2 * figure.bbox.width
