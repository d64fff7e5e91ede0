"""Weights of sensors: over a SLAM run, the trade-off curves of one pose, and those of a solve's groups."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, StrMethodFormatter

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray
from sfmcpp.slam import KeyframeRecord
from sfmcpp.study.plotting.style import COLORS, MUTED, as_label, new_figure, style_axes
from sfmcpp.weighting import WeightSelection
from sfmcpp.weighting.conflict import CONFLICT_SIGMAS

# Keyframes drawn for each sensor, spread evenly over the run.
SHOWN = 6
# Relative increases of the images' error below this are rounding, and drawn here.
SMALLEST_INCREASE = 1e-5
# So are errors of the constraint below this share of the largest; a logarithmic axis has no place for zero.
_SMALLEST_ERROR = 1e-12

Chosen = tuple[float, WeightSelection]


def plot_weights(records: list[KeyframeRecord], *, start_s: float | None = None) -> Figure:
    """Plot the weight of each sensor's constraint, and its disagreement with the images, over time.

    Parameters
    ----------
    records : list of KeyframeRecord
        Of a run with sensors. Weights of zero, which have no place on a logarithmic scale, are crosses below.
    start_s : float, optional
        Time that is zero in the figure, such as that of the first keyframe, which has no record; default:
        that of the first record.

    Returns
    -------
    matplotlib.figure.Figure
        Not shown, not registered with pyplot.
    """
    figure = new_figure(10, 5)
    weights, conflicts = figure.subplots(2, 1, sharex=True)
    start = _start_s(records, start_s)
    names = sorted({name for record in records for name in record.weights})
    for name, color in zip(names, COLORS, strict=False):
        _draw_weights(weights, name, color, _weight_series(records, "weights", name, start))
        conflicts.plot(*_weight_series(records, "conflicts", name, start), ".-", color=color, linewidth=1.0)
    weights.set_title(
        "Weight of each sensor at each keyframe: a larger λ keeps the solution closer to the sensor"
    )
    conflicts.set_title("Disagreement of sensor and images: significant above the dashed line")
    weights.set_ylabel("weight λ")
    conflicts.set_ylabel("disagreement [σ]")
    conflicts.set_xlabel("time [s]")
    conflicts.axhline(CONFLICT_SIGMAS, color=MUTED, linewidth=1.0, linestyle="--")
    conflicts.set_ylim(bottom=0.0)  # last: it ends what makes room for the line
    for axes in (weights, conflicts):
        axes.title.set_fontsize(10)
        style_axes(axes)
    if names:
        weights.legend(fontsize=9, frameon=False)
    return figure


def _start_s(records: Sequence[KeyframeRecord], given: float | None) -> float:
    first = records[0].t_s if records else 0.0
    return first if given is None else given


def _weight_series(
    records: list[KeyframeRecord], field: str, name: str, start_s: float
) -> tuple[np.ndarray, ...]:
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


def has_curves(records: Sequence[KeyframeRecord]) -> bool:
    """Whether any weight of a run was chosen from a curve, not prescribed."""
    return any(True for record in records for _ in _trade_off_curves(record))


def plot_trade_off(records: Sequence[KeyframeRecord], *, start_s: float | None = None) -> Figure:
    """Plot the curves of some keyframes of each sensor, a row each.

    Left, what the images lose against what the constraint gains as its weight grows; right, what the
    criterion minimises, scaled to [0, 1], over the weight. A dot is the chosen weight; a cross at the left
    edge is λ = 0.

    Parameters
    ----------
    records : sequence of KeyframeRecord
        Of a run with sensors.
    start_s : float, optional
        Time that is zero in the legend; see :func:`plot_weights`.

    Returns
    -------
    matplotlib.figure.Figure
        Not shown, not registered with pyplot.
    """
    start = _start_s(records, start_s)
    names = sorted({selection.name for record in records for selection in _trade_off_curves(record)})
    figure = new_figure(10, 4 * max(len(names), 1))
    panels = figure.subplots(max(len(names), 1), 2, squeeze=False)
    figure.suptitle(
        "Choice of the sensor weight at some keyframes: one curve per keyframe, a dot at the chosen weight"
    )
    for name, (errors, scores) in zip(names, panels, strict=True):
        for chosen, color in zip(_evenly_chosen([*_of_sensor(records, name, start)]), COLORS, strict=False):
            _draw_errors(errors, chosen, color)
            _draw_scores(scores, chosen, color)
        _finish(errors, scores, name, _first_record(records, name))
    for axes in panels.flat:
        style_axes(axes)
    return figure


def _trade_off_curves(record: KeyframeRecord) -> Iterator[WeightSelection]:
    """Weights that were chosen; prescribed ones have no score that differs."""
    for selection in record.selections:
        if np.ptp(_finite_scores(selection.score)) > 0:
            yield selection


def _of_sensor(records: Sequence[KeyframeRecord], name: str, start_s: float) -> Iterator[Chosen]:
    for record in records:
        for selection in _trade_off_curves(record):
            if selection.name == name:
                yield record.t_s - start_s, selection


def _evenly_chosen(chosen: Sequence[Chosen]) -> list[Chosen]:
    """At most `SHOWN` of them, evenly from the first to the last."""
    rows = np.unique(np.linspace(0, len(chosen) - 1, SHOWN).round().astype(int))
    return [chosen[row] for row in rows]


def _draw_errors(axes: Axes, chosen: Chosen, color: str) -> None:
    seconds, selection = chosen
    increase = np.maximum(selection.vision / selection.vision[0] - 1, SMALLEST_INCREASE)
    error = np.maximum(selection.constraint_error, _SMALLEST_ERROR * selection.constraint_error.max())
    axes.plot(error, increase, color=color, linewidth=1.2)
    at = selection.weights == selection.weight
    label = f"{seconds:.4g} s: λ = {selection.weight:.3g}"
    axes.plot(
        error[at],
        increase[at],
        "o",
        color=color,
        markersize=6,
        clip_on=False,
        label=label,
    )


def _draw_scores(axes: Axes, chosen: Chosen, color: str) -> None:
    _, selection = chosen
    weights, height = selection.weights, _scaled_scores(selection.score)
    axes.plot(weights[weights > 0], height[weights > 0], color=color, linewidth=1.2)
    at = weights == selection.weight
    if selection.weight > 0:
        axes.plot(weights[at], height[at], "o", color=color, markersize=6, clip_on=False)
    else:
        axes.plot(0.01, height[at][0], "x", color=color, markersize=6, transform=axes.get_yaxis_transform())


def _finite_scores(score: FloatArray) -> FloatArray:
    finite = score[np.isfinite(score)]
    return finite if len(finite) else np.zeros(1)


def _scaled_scores(score: FloatArray) -> FloatArray:
    """Scores from 0 to 1; gaps where the criterion may not choose."""
    low, high = np.min(_finite_scores(score)), np.max(_finite_scores(score))
    return np.where(np.isfinite(score), (score - low) / (high - low), np.nan)


def _first_record(records: Sequence[KeyframeRecord], name: str) -> WeightSelection:
    return next(selection for _, selection in _of_sensor(records, name, 0.0))


def _finish(errors: Axes, scores: Axes, name: str, example: WeightSelection) -> None:
    errors.set_title(f"{name}: trade-off; low weights to the right, high weights to the left", fontsize=10)
    scores.set_title(f"{name}: the lowest score within the bounds is chosen", fontsize=10)
    errors.set_xscale("log")
    errors.set_yscale("log")
    scores.set_xscale("log")
    scores.xaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    scores.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    scores.xaxis.set_minor_locator(NullLocator())
    errors.set_xlabel(f"mean squared error of the {name} [{example.unit}²]")
    errors.set_ylabel("relative increase of the image error")
    scores.set_xlabel("weight λ")
    scores.set_ylabel(f"score of {example.method} (scaled to 0…1)")
    errors.legend(fontsize=8, frameon=False)


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
        _draw_group_errors(errors, selection, color)
        _draw_group_scores(scores, selection, color)
        for axes in (errors, scores):
            axes.title.set_fontsize(10)
            style_axes(axes)
    return figure


def _colors(count: int) -> list[str]:
    return [COLORS[k % len(COLORS)] for k in range(count)]


def _draw_group_errors(axes: Axes, selection: WeightSelection, color: str) -> None:
    drawn = selection.constraint_error > 0
    errors, images = np.sqrt(selection.constraint_error[drawn]), np.sqrt(selection.vision[drawn])
    axes.plot(errors, images, ".-", color=color, linewidth=1.2, markersize=4)
    at = (selection.weights == selection.weight)[drawn]
    axes.plot(errors[at], images[at], "o", color=color, markersize=7, clip_on=False)
    _finish_axes(axes, errors)
    name = as_label(selection.name)
    axes.set_xlabel(f"RMS error of {name} [{selection.unit}]")
    axes.set_ylabel("RMS error of the images [σ]")
    axes.set_title(f"{name}: ignored at the right end, obeyed at the left")


def _draw_group_scores(axes: Axes, selection: WeightSelection, color: str) -> None:
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
