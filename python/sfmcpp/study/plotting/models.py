"""A model compared with the ground truth: camera positions, and the errors of each camera."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sfmcpp.model.arrays import FloatArray
from sfmcpp.study.evaluation import ModelEvaluation
from sfmcpp.study.plotting.style import COLORS, MUTED, new_figure, style_axes

# Length of a line of sight, as a share of the extent of the centres.
_SIGHT = 0.08
_MOST_NAMES = 40


def plot_model_evaluation(evaluation: ModelEvaluation) -> Figure:
    """Plot the cameras in their two widest directions, and the errors of each.

    Parameters
    ----------
    evaluation : ModelEvaluation
        What :func:`sfmcpp.study.evaluation.evaluate_model` returned.

    Returns
    -------
    matplotlib.figure.Figure
        Not shown, not registered with pyplot.
    """
    figure = new_figure(12, 4.5)
    cameras, centres, rotations = figure.subplots(1, 3)
    _draw_cameras(cameras, evaluation)
    _draw_errors(centres, evaluation.centre_errors, "centre error [unit of ground truth]", evaluation)
    _draw_errors(rotations, evaluation.rotation_errors_deg, "rotation error [deg]", evaluation)
    for axes in (cameras, centres, rotations):
        style_axes(axes)
    return figure


def _draw_cameras(axes: Axes, evaluation: ModelEvaluation) -> None:
    extents = np.ptp(evaluation.truth[:, :, 3], axis=0)
    shown = sorted(np.argsort(extents, kind="stable")[-2:].tolist())
    length = _SIGHT * (float(extents.max()) or 1.0)
    looks = (
        ("ground truth", evaluation.truth, MUTED, "o", 6),
        ("model", evaluation.estimate, COLORS[0], ".", 5),
    )
    for label, poses, color, marker, size in looks:
        centres, ends = poses[:, shown, 3], poses[:, shown, 3] + length * poses[:, shown, 2]
        segments = np.stack([centres, ends, np.full_like(ends, np.nan)], axis=1).reshape(-1, 2)
        axes.plot(*segments.T, color=color, linewidth=1.0)
        axes.plot(*centres.T, marker, color=color, markersize=size, fillstyle="none", label=label)
    axes.set_xlabel(f"{'xyz'[shown[0]]} [unit of ground truth]")
    axes.set_ylabel(f"{'xyz'[shown[1]]} [unit of ground truth]")
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_title(f"{len(evaluation.names)} of {evaluation.num_images} images compared", fontsize=10)
    axes.legend(fontsize=9, frameon=False)


def _draw_errors(axes: Axes, errors: FloatArray, label: str, evaluation: ModelEvaluation) -> None:
    rows = np.arange(len(errors))
    outlying = np.isin(evaluation.names, evaluation.outliers)
    colors = [COLORS[1] if out else COLORS[0] for out in outlying]
    axes.bar(rows, errors, color=colors, width=0.7)
    axes.axhline(float(errors.mean()), color=MUTED, linewidth=1.0, linestyle="--")
    if len(errors) <= _MOST_NAMES:
        axes.set_xticks(rows, evaluation.names, rotation=90, fontsize=7)
    else:
        axes.set_xlabel("image")
    axes.set_ylabel(f"{label}   (mean {errors.mean():.3g})")
