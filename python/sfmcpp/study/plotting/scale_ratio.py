"""How the scale of a trajectory holds over time."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from sfmcpp.model.arrays import FloatArray
from sfmcpp.study.evaluation import Matched, scale_ratios
from sfmcpp.study.plotting.style import COLORS, MUTED, new_figure, style_axes
from sfmcpp.weighting.criteria import MEDIAN_WIDTH, running_median

# The axis shows at least this much beside 1.
_LEAST_DEVIATION = 0.05


def plot_scale_ratio(pairs: Matched, *, scaled: str = "") -> Figure:
    """Plot the length of each step over that of the true one (thesis eq. 5.25), and a running median.

    Parameters
    ----------
    pairs : Matched
        Keyframes, in metres or scaled to them, and their true poses. Steps of a standing camera do not count.
    scaled : str
        How the scale was brought to metres, for the legend.

    Returns
    -------
    matplotlib.figure.Figure
        Not shown, not registered with pyplot.
    """
    seconds, ratios = _ratios(pairs)
    figure = new_figure(10, 4)
    axes = figure.subplots()
    axes.axhline(1.0, color=MUTED, linewidth=1.0, linestyle="--", label="truth")
    label = f"step from keyframe to keyframe{', ' if scaled else ''}{scaled}"
    axes.plot(seconds, ratios, ".", color=COLORS[5], markersize=5, label=label)
    if len(ratios) >= MEDIAN_WIDTH:
        smooth = running_median(ratios)
        shown = np.isfinite(smooth)
        text = f"median of {MEDIAN_WIDTH}"
        axes.plot(seconds[shown], smooth[shown], color=COLORS[0], linewidth=1.6, label=text)
    mean = f"   (mean {ratios.mean():.4g})" if len(ratios) else ""
    axes.set_ylabel(f"estimated over true length{mean}")
    axes.set_xlabel("seconds" if pairs.truth.stamped else "frame")
    axes.set_ylim(*_limits(ratios))
    axes.legend(fontsize=9, frameon=False, loc="lower left")
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
    """From a little below the least to a little above the largest, 1 inside."""
    low = min(1 - _LEAST_DEVIATION, float(ratios.min(initial=1.0)))
    high = max(1 + _LEAST_DEVIATION, float(ratios.max(initial=1.0)))
    room = 0.05 * (high - low)
    return low - room, high + room
