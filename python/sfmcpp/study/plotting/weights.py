"""How much each sensor counted over a SLAM run, and how well it agreed with the images."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sfmcpp.slam import KeyframeRecord
from sfmcpp.study.plotting.style import COLORS, MUTED, new_figure, style_axes
from sfmcpp.weighting.conflict import CONFLICT_SIGMAS


def plot_weights(records: list[KeyframeRecord]) -> Figure:
    """Plot the weight of each sensor's constraint, and its disagreement with the images, over time.

    Parameters
    ----------
    records : list of KeyframeRecord
        Of a run with sensors. Weights of zero, which have no place on a logarithmic scale, are crosses below.

    Returns
    -------
    matplotlib.figure.Figure
        Not shown, not registered with pyplot.
    """
    figure = new_figure(10, 5)
    weights, conflicts = figure.subplots(2, 1, sharex=True)
    start = records[0].t_s if records else 0.0
    names = sorted({name for record in records for name in record.weights})
    for name, color in zip(names, COLORS, strict=False):
        _draw_weights(weights, name, color, _series(records, "weights", name, start))
        conflicts.plot(*_series(records, "conflicts", name, start), ".-", color=color, linewidth=1.0)
    weights.set_ylabel("weight λ")
    conflicts.set_ylabel("disagreement [σ]")
    conflicts.set_xlabel("seconds")
    conflicts.set_ylim(bottom=0.0)
    conflicts.axhline(CONFLICT_SIGMAS, color=MUTED, linewidth=1.0, linestyle="--")
    for axes in (weights, conflicts):
        style_axes(axes)
    if names:
        weights.legend(fontsize=9, frameon=False)
    return figure


def _series(records: list[KeyframeRecord], field: str, name: str, start_s: float) -> tuple[np.ndarray, ...]:
    """Seconds and values of the keyframes that have one."""
    rows = [(r.t_s - start_s, getattr(r, field)[name]) for r in records if name in getattr(r, field)]
    seconds, values = np.array(rows, dtype=np.float64).reshape(-1, 2).T
    return seconds, values


def _draw_weights(axes: Axes, name: str, color: str, series: tuple[np.ndarray, ...]) -> None:
    seconds, values = series
    used = values > 0
    axes.plot(seconds[used], values[used], ".-", color=color, linewidth=1.0, label=name)
    if used.any():
        axes.set_yscale("log")
    axes.plot(
        seconds[~used],
        np.full(np.count_nonzero(~used), 0.02),
        "x",
        color=color,
        markersize=5,
        transform=axes.get_xaxis_transform(),
    )
