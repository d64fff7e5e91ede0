"""The view from above draws x to the right and z upwards, and says how the path was aligned."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from sfmcpp.study.plotting import save_figure
from sfmcpp.study.plotting.evaluations import plot_top_view

PATH = np.array([[0.0, 5.0, 0.0], [1.0, 6.0, 2.0], [1.5, 7.0, 8.0]])
POINTS = np.array([[3.0, 0.0, 4.0], [900.0, 0.0, 4.0]])


def drawn(figure: Figure) -> dict[str, list[list[float]]]:
    """Coordinates of each line of the figure by its label."""
    return {str(line.get_label()): np.asarray(line.get_xydata()).tolist() for line in figure.axes[0].lines}


def test_x_goes_right_and_z_goes_up() -> None:
    figure = plot_top_view(PATH, PATH[::2], POINTS)
    lines = drawn(figure)
    assert lines["estimate"] == [[0, 0], [1, 2], [1.5, 8]]
    assert lines["keyframes"] == [[0, 0], [1.5, 8]]
    assert lines["start"] == [[0, 0]]
    assert "ground truth" not in lines
    assert "unknown" in figure.axes[0].get_xlabel()


def test_truth_is_drawn_beside_an_estimate_whose_alignment_is_named() -> None:
    figure = plot_top_view(
        PATH, PATH, POINTS, truth=PATH + 1, alignment="aligned to the whole trajectory", unit="m"
    )
    lines = drawn(figure)
    assert lines["ground truth"] == [[1, 1], [2, 3], [2.5, 9]]
    assert lines["estimate, aligned to the whole trajectory"] == [[0, 0], [1, 2], [1.5, 8]]
    assert "[m]" in figure.axes[0].get_xlabel()


def test_predicted_frames_are_marked() -> None:
    assert drawn(plot_top_view(PATH, PATH[:1], POINTS, predicted=[1, 2]))["predicted frames"] == [
        [1, 2],
        [1.5, 8],
    ]
    assert "predicted frames" not in drawn(plot_top_view(PATH, PATH[:1], POINTS))


def test_window_and_figure_have_the_shape_of_the_paths_whatever_the_points() -> None:
    figure = plot_top_view(PATH, PATH, POINTS, truth=PATH + 1)
    axes = figure.axes[0]
    (left, right), (low, high) = axes.get_xlim(), axes.get_ylim()
    assert right - left < (high - low) / 2
    assert figure.get_figwidth() < figure.get_figheight()
    assert left < 0 < 2.5 < right
    assert low < 0 < 9 < high
    assert right < 20


def test_the_truth_shows_where_the_estimate_lies_on_it() -> None:
    lines = {
        str(line.get_label()): line for line in plot_top_view(PATH, PATH, POINTS, truth=PATH).axes[0].lines
    }
    assert lines["ground truth"].get_linewidth() > 2 * lines["estimate"].get_linewidth()


def test_a_standing_camera_is_drawn_without_a_warning(tmp_path: Path) -> None:
    figure = plot_top_view(PATH[:1], PATH[:1], POINTS[:0])
    save_figure(figure, tmp_path / "top.png")
    assert (tmp_path / "top.png").stat().st_size > 0


@pytest.mark.parametrize("way", [(0.0, 200.0), (200.0, 0.0), (150.0, 150.0)])
def test_the_legend_is_whole_whatever_the_way(way: tuple[float, float]) -> None:
    path = np.linspace([0.0, 0.0, 0.0], [way[0], 0.0, way[1]], 30)
    alignment = "aligned to the whole trajectory, by poses"
    figure = plot_top_view(path, path[::3], POINTS, truth=path, alignment=alignment, unit="m")
    figure.canvas.draw()
    (legend,) = figure.legends
    box = legend.get_window_extent()
    assert box.x0 >= 0
    assert box.x1 <= figure.bbox.x1
    assert not box.overlaps(figure.axes[0].get_window_extent())
