"""A trajectory beside the truth, and its error along the way."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sfmcpp.study.evaluation import Evaluation
from sfmcpp.study.plotting.style import COLORS, MUTED, new_figure, style_axes


def plot_evaluation(evaluation: Evaluation) -> Figure:
    """Plot both paths from the side that shows most of them, and the distance between them.

    Parameters
    ----------
    evaluation : Evaluation
        What :func:`sfmcpp.study.evaluation.evaluate` returned.

    Returns
    -------
    matplotlib.figure.Figure
        Not shown, not registered with pyplot.
    """
    figure = new_figure(10, 4.5)
    paths, errors = figure.subplots(1, 2)
    _draw_paths(paths, evaluation)
    _draw_errors(errors, evaluation)
    for axes in (paths, errors):
        style_axes(axes)
    return figure


def _draw_paths(axes: Axes, evaluation: Evaluation) -> None:
    truth, estimate = evaluation.truth.centres, evaluation.estimate.centres
    across, up = sorted(np.argsort(np.ptp(truth, axis=0), kind="stable")[-2:].tolist())
    axes.plot(truth[:, across], truth[:, up], color=MUTED, linewidth=1.6, linestyle="--", label="truth")
    axes.plot(estimate[:, across], estimate[:, up], color=COLORS[0], linewidth=1.6, label="estimate")
    axes.plot(*truth[0, [across, up]], "o", color=MUTED, markersize=5, label="start")
    axes.set_xlabel(f"{'xyz'[across]} [m]")
    axes.set_ylabel(f"{'xyz'[up]} [m]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.legend(fontsize=9, frameon=False)


def _draw_errors(axes: Axes, evaluation: Evaluation) -> None:
    stamps = evaluation.truth.t_s
    error = evaluation.ape["translation_part"]
    stamped = evaluation.truth.stamped
    axes.plot(stamps - stamps[0], error, color=COLORS[0], linewidth=1.6)
    axes.axhline(evaluation.mean_3d_error_m, color=MUTED, linewidth=1.0, linestyle="--")
    count = evaluation.alignment.count
    if 0 < count < len(stamps):
        axes.axvspan(0.0, stamps[count - 1] - stamps[0], color=COLORS[4], alpha=0.15, linewidth=0)
    axes.set_xlabel("seconds" if stamped else "frame")
    axes.set_ylabel(f"position error [m]   (mean {evaluation.mean_3d_error_m:.3g} m)")
    axes.set_ylim(bottom=0.0)
