"""A trajectory and its map from above."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sfmcpp.model.arrays import FloatArray
from sfmcpp.study.plotting.style import COLORS, MUTED, new_figure, style_axes

# Room around the paths for points, as a share of the paths' extent; farther points are cut off.
_MARGIN = 0.15


def plot_top_view(
    path: FloatArray,
    keyframes: FloatArray,
    points: FloatArray,
    *,
    truth: FloatArray | None = None,
    alignment: str = "",
    unit: str = "",
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

    Returns
    -------
    matplotlib.figure.Figure
        Not shown, not registered with pyplot.
    """
    figure = new_figure(7, 7)
    axes = figure.subplots()
    axes.plot(points[:, 0], points[:, 2], ".", color="#b8c4ce", markersize=1.5, label="points", zorder=1)
    if truth is not None:
        axes.plot(truth[:, 0], truth[:, 2], color=MUTED, linewidth=1.6, linestyle="--", label="truth")
    label = f"estimate, {alignment}" if alignment else "estimate"
    axes.plot(path[:, 0], path[:, 2], color=COLORS[0], linewidth=1.6, label=label)
    axes.plot(keyframes[:, 0], keyframes[:, 2], ".", color=COLORS[0], markersize=5, label="keyframes")
    axes.plot(path[0, 0], path[0, 2], "o", color=COLORS[1], markersize=6, label="start")
    _frame(axes, path if truth is None else np.concatenate([path, truth]))
    axes.set_xlabel(f"x, right [{unit}]" if unit else "x, right (scale unknown)")
    axes.set_ylabel(f"z, ahead [{unit}]" if unit else "z, ahead (scale unknown)")
    axes.legend(fontsize=9, frameon=False)
    style_axes(axes)
    return figure


def _frame(axes: Axes, paths: FloatArray) -> None:
    """Show a square around the paths, the same length in both directions."""
    low, high = paths[:, [0, 2]].min(axis=0), paths[:, [0, 2]].max(axis=0)
    half = (0.5 + _MARGIN) * float((high - low).max()) or 1.0
    (x, z) = (low + high) / 2
    axes.set_xlim(x - half, x + half)
    axes.set_ylim(z - half, z + half)
    axes.set_aspect("equal", adjustable="box")
