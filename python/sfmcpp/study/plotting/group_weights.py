"""The curves that the weights of a solve's groups were chosen from."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.weight_selection import WeightSelection
from sfmcpp.study.plotting.style import COLORS, MUTED, new_figure, style_axes


def plot_group_weights(selections: Sequence[WeightSelection]) -> Figure:
    """Plot what was tried for the weight of each group of a solve, a row each; a dot is the choice.

    Left, the error of the images against that of the group: an L-curve, from a group that is ignored, below
    right, to one that is obeyed. Right, what the method minimises over the weight; gaps where it may not
    choose. "variance" tries no grid: drawn are its steps to the choice.

    Parameters
    ----------
    selections : sequence of WeightSelection
        Such as ``summary.group_weights``.

    Returns
    -------
    matplotlib.figure.Figure
        Not shown, not registered with pyplot.

    Raises
    ------
    InvalidArgument
        If there is none.
    """
    if not selections:
        raise InvalidArgument("selections: there are none; a solve with weight='loo-approx', say, has some")
    figure = new_figure(10, 4 * len(selections))
    panels = figure.subplots(len(selections), 2, squeeze=False)
    for selection, color, (errors, scores) in zip(selections, _colors(len(selections)), panels, strict=True):
        _draw_errors(errors, selection, color)
        _draw_scores(scores, selection, color)
        for axes in (errors, scores):
            axes.title.set_fontsize(10)
            style_axes(axes)
    return figure


def _colors(count: int) -> list[str]:
    return [COLORS[k % len(COLORS)] for k in range(count)]


def _draw_errors(axes: Axes, selection: WeightSelection, color: str) -> None:
    drawn = selection.constraint_error > 0
    errors, images = np.sqrt(selection.constraint_error[drawn]), np.sqrt(selection.vision[drawn])
    axes.plot(errors, images, ".-", color=color, linewidth=1.2, markersize=4)
    at = (selection.weights == selection.weight)[drawn]
    axes.plot(errors[at], images[at], "o", color=color, markersize=7, clip_on=False)
    _finish_axes(axes, errors)
    axes.set_xlabel(f"RMS error of {selection.name} [{selection.unit}]")
    axes.set_ylabel("RMS error of the images [σ]")
    axes.set_title(f"{selection.name}: ignored at the right end, obeyed at the left")


def _draw_scores(axes: Axes, selection: WeightSelection, color: str) -> None:
    drawn = selection.weights > 0
    weights, scores = selection.weights[drawn], selection.score[drawn]
    scores = np.where(np.isfinite(scores), scores, np.nan)
    axes.plot(weights, scores, ".-", color=color, linewidth=1.2, markersize=4)
    if selection.weight > 0:
        axes.axvline(selection.weight, color=MUTED, linewidth=1.0, linestyle="--")
    at = weights == selection.weight
    axes.plot(weights[at], scores[at], "o", color=color, markersize=7, clip_on=False)
    _finish_axes(axes, weights)
    axes.set_xlabel("weight w")
    axes.set_ylabel(f"score of {selection.method}: the smaller, the better")
    amounts = f"σ = {selection.sensor_sigma:.3g} {selection.unit}" if selection.weight > 0 else "left out"
    axes.set_title(f"chosen: {selection.weight:.3g} ({amounts})")


def _finish_axes(axes: Axes, values: FloatArray) -> None:
    """Logarithmic from a decade on; numbers as they are."""
    if len(values) and values.max() >= 10 * values.min():
        axes.set_xscale("log")
    else:
        axes.ticklabel_format(axis="x", useOffset=False)
    axes.ticklabel_format(axis="y", useOffset=False)
