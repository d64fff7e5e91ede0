"""Trajectories and models compared with the ground truth, from above with the map, and scale drift."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sfmcpp.model.arrays import FloatArray
from sfmcpp.study.evaluation import Evaluation, Matched, ModelEvaluation, scale_ratios
from sfmcpp.study.plotting.style import COLORS, MUTED, new_figure, style_axes
from sfmcpp.weighting.criteria import MEDIAN_WIDTH, running_median

# Room around the paths for points, as a share of the paths' extent; farther points are cut off.
_MARGIN = 0.15
# Extent shown of a straight way at least: its length over this, across it.
_LONGEST_TO_WIDEST = 3.0
# Sides of a view from above [in], and room for its title and legend.
_LONG_SIDE_IN = 8.0
_SHORT_SIDE_IN = 5.0
_TEXT_IN = 1.2
# Width of the errors of an evaluation over the height of its ways, and limits of that of the ways.
_WIDTH_OF_ERRORS, _WIDTHS_BESIDE_ERRORS = 1.2, (0.45, 1.6)
# The axis shows at least this much beside 1.
_LEAST_DEVIATION = 0.05
# Length of a line of sight, as a share of the extent of the centres.
_SIGHT = 0.08
_MOST_NAMES = 40


def plot_evaluation(evaluation: Evaluation) -> Figure:
    """Plot both trajectories in their two widest directions, and the position error.

    Parameters
    ----------
    evaluation : Evaluation
        What :func:`sfmcpp.study.evaluation.evaluate` returned.

    Returns
    -------
    matplotlib.figure.Figure
        Not shown, not registered with pyplot.
    """
    truth, estimate = evaluation.truth.centres, evaluation.estimate.centres
    seen = sorted(np.argsort(np.ptp(truth, axis=0), kind="stable")[-2:].tolist())
    low, high = _bounds(np.concatenate([truth, estimate])[:, seen])
    share = np.clip((high - low)[0] / (high - low)[1], *_WIDTHS_BESIDE_ERRORS)
    figure = new_figure(10, 4.5)
    paths, errors = figure.subplots(1, 2, width_ratios=[share, _WIDTH_OF_ERRORS])
    _draw_paths(paths, truth[:, seen], estimate[:, seen], "estimate")
    _set_limits(paths, low, high)
    paths.set_xlabel(f"{'xyz'[seen[0]]} [m]")
    paths.set_ylabel(f"{'xyz'[seen[1]]} [m]")
    figure.legend(fontsize=9, frameon=False, loc="outside lower left", ncols=3)
    _draw_errors(errors, evaluation)
    for axes in (paths, errors):
        style_axes(axes)
    return figure


def _draw_paths(axes: Axes, truth: FloatArray | None, estimate: FloatArray, label: str) -> None:
    """Both ways (n, 2), the true one wider, so that it shows on both sides of an estimate that lies on it."""
    if truth is not None:
        axes.plot(*truth.T, color=COLORS[4], linewidth=5.0, alpha=0.6, label="ground truth")
    axes.plot(*estimate.T, color=COLORS[0], linewidth=1.6, label=label)
    axes.plot(*estimate[0], "o", color=COLORS[1], markersize=6, label="start")


def _set_limits(axes: Axes, low: FloatArray, high: FloatArray) -> None:
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal", adjustable="box")


def _draw_errors(axes: Axes, evaluation: Evaluation) -> None:
    stamps = evaluation.truth.t_s
    error = evaluation.ape["translation_part"]
    stamped = evaluation.truth.stamped
    axes.plot(stamps - stamps[0], error, color=COLORS[0], linewidth=1.6)
    axes.axhline(evaluation.mean_3d_error_m, color=MUTED, linewidth=1.0, linestyle="--")
    count = evaluation.alignment.count
    if 0 < count < len(stamps):
        axes.axvspan(0.0, stamps[count - 1] - stamps[0], color=COLORS[4], alpha=0.15, linewidth=0)
    axes.set_xlabel("time [s]" if stamped else "frame")
    axes.set_ylabel(f"position error [m]   (mean {evaluation.mean_3d_error_m:.3g} m)")
    axes.set_ylim(bottom=0.0)


def plot_top_view(
    path: FloatArray,
    keyframes: FloatArray,
    points: FloatArray,
    *,
    truth: FloatArray | None = None,
    alignment: str = "",
    unit: str = "",
    predicted: Sequence[int] = (),
) -> Figure:
    """Plot a path from above, x to the right and z upwards, in the frame of a camera that looks along z.

    Parameters
    ----------
    path : (n, 3) float64
        Centres of the camera, in order.
    keyframes : (K, 3) float64
        Centres of the keyframes.
    points : (N, 3) float64
        Points of the map; those far from the paths are cut off.
    truth : (m, 3) float64, optional
        True centres, in the same frame.
    alignment : str
        How the path was brought to the truth, for the legend.
    unit : str
        Of lengths; empty for a map of unknown scale.
    predicted : sequence of int
        Places in the path where images said too little.

    Returns
    -------
    matplotlib.figure.Figure
        Not shown, not registered with pyplot.
    """
    shown = path if truth is None else np.concatenate([path, truth])
    low, high = _bounds(shown[:, [0, 2]])
    figure = new_figure(*_size_of(high - low))
    axes = figure.subplots()
    axes.plot(points[:, 0], points[:, 2], ".", color="#8fa1af", markersize=2, label="points", zorder=1)
    label = f"estimate, {alignment}" if alignment else "estimate"
    _draw_paths(axes, None if truth is None else truth[:, [0, 2]], path[:, [0, 2]], label)
    axes.plot(keyframes[:, 0], keyframes[:, 2], ".", color=COLORS[0], markersize=5, label="keyframes")
    if len(predicted):
        there = path[list(predicted)]
        axes.plot(there[:, 0], there[:, 2], "x", color=COLORS[3], markersize=5, label="predicted frames")
    _set_limits(axes, low, high)
    axes.set_title("Camera trajectory, top view", fontsize=11)
    axes.set_xlabel(f"x, right [{unit}]" if unit else "x, right (unknown scale)")
    axes.set_ylabel(f"z, forward [{unit}]" if unit else "z, forward (unknown scale)")
    is_wide = figure.get_figwidth() >= _LONG_SIDE_IN
    figure.legend(fontsize=9, frameon=False, loc="outside lower center", ncols=3 if is_wide else 1)
    style_axes(axes)
    return figure


def _bounds(paths: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and largest coordinates around paths (n, 2), with room for points, beside a straight way too."""
    low, high = paths.min(axis=0), paths.max(axis=0)
    longest = float((high - low).max()) or 1.0
    half = np.maximum((high - low) / 2 + _MARGIN * longest, longest / (2 * _LONGEST_TO_WIDEST))
    return (low + high) / 2 - half, (low + high) / 2 + half


def _size_of(extent: FloatArray) -> tuple[float, float]:
    """Width and height [in] of a figure for that extent, the longer side always the same."""
    width, height = _LONG_SIDE_IN * extent / extent.max()
    return max(width, _SHORT_SIDE_IN), height + _TEXT_IN


def plot_scale_ratio(pairs: Matched, *, scaled: str = "", sigmas: FloatArray | None = None) -> Figure:
    """Plot the length of each step over that of the true one (thesis eq. 5.25), and a running median.

    Parameters
    ----------
    pairs : Matched
        Keyframes, in metres or scaled to them, and their true poses. Steps of a standing camera do not count.
    scaled : str
        How the scale was brought to metres, for the legend.
    sigmas : (n,) float64, optional
        Standard deviation of the logarithm of the scale at each pose against that at the first one, as the
        images hold it (:func:`sfmcpp.slam.scale_sigmas`): drawn as a band.

    Returns
    -------
    matplotlib.figure.Figure
        Not shown, not registered with pyplot.
    """
    seconds, ratios = _ratios(pairs)
    figure = new_figure(10, 4)
    axes = figure.subplots()
    if sigmas is not None and len(ratios):
        times = pairs.truth.t_s - pairs.truth.t_s[0]
        start = float(np.median(ratios[:MEDIAN_WIDTH]))
        band = (start * np.exp(-sigmas), start * np.exp(sigmas))
        label = "expected of images, ± one standard deviation"
        axes.fill_between(times, *band, color=COLORS[0], alpha=0.12, linewidth=0, label=label)
    axes.axhline(1.0, color=MUTED, linewidth=1.0, linestyle="--", label="ground truth")
    label = f"step between keyframes{', ' if scaled else ''}{scaled}"
    axes.plot(seconds, ratios, ".", color=COLORS[5], markersize=5, label=label)
    if len(ratios) >= MEDIAN_WIDTH:
        smooth = running_median(ratios)
        shown = np.isfinite(smooth)
        text = f"running median of {MEDIAN_WIDTH}"
        axes.plot(seconds[shown], smooth[shown], color=COLORS[0], linewidth=1.6, label=text)
    mean = f"   (mean {ratios.mean():.4g})" if len(ratios) else ""
    axes.set_ylabel(f"estimated length / true length{mean}")
    axes.set_xlabel("time [s]" if pairs.truth.stamped else "frame")
    axes.set_ylim(*_limits(ratios))
    axes.legend(fontsize=9, frameon=False, loc="best")
    style_axes(axes)
    return figure


def _ratios(pairs: Matched) -> tuple[FloatArray, FloatArray]:
    """Seconds since the start, and the ratio of the step that ends there; standing steps are left out."""
    ours, true = pairs.estimate.poses, pairs.truth.poses
    found = [scale_ratios(ours[k - 1 : k + 1], true[k - 1 : k + 1]) for k in range(1, len(true))]
    moving = np.array([len(ratio) > 0 for ratio in found], dtype=bool)
    times = pairs.truth.t_s
    ratios = np.concatenate([np.empty(0), *found])
    return times[1:][moving] - times[0], ratios


def _limits(ratios: FloatArray) -> tuple[float, float]:
    """Limits of an axis, from a little below the least ratio to a little above the largest, 1 inside."""
    low = min(1 - _LEAST_DEVIATION, float(ratios.min(initial=1.0)))
    high = max(1 + _LEAST_DEVIATION, float(ratios.max(initial=1.0)))
    room = 0.05 * (high - low)
    return low - room, high + room


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
    _draw_camera_errors(centres, evaluation.centre_errors, "centre error [unit of ground truth]", evaluation)
    _draw_camera_errors(rotations, evaluation.rotation_errors_deg, "rotation error [deg]", evaluation)
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


def _draw_camera_errors(axes: Axes, errors: FloatArray, label: str, evaluation: ModelEvaluation) -> None:
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
