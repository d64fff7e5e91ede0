"""How the cost falls, over iterations and over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from sfmcpp.ba import Iteration, Summary
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import checked
from sfmcpp.study.plotting.style import COLORS, MUTED, new_figure, style_axes

Run = Summary | Sequence[Iteration]

# Relative distances to the best known cost below this are rounding, and drawn here.
SMALLEST_GAP = 1e-9


@dataclass(frozen=True)
class _Curve:
    name: str
    color: str
    iteration: NDArray[np.int64]
    seconds: NDArray[np.float64]
    height: NDArray[np.float64]
    accepted: NDArray[np.bool_]


@checked()
def plot_convergence(runs: Run | Mapping[str, Run], *, best_cost: float | None = None) -> Figure:
    """Plot cost against iterations and against seconds, on a logarithmic scale.

    A dot is an accepted step, a cross a rejected one; the last value is written at the end of a lone curve.

    Parameters
    ----------
    runs : Summary, sequence of Iteration, or mapping of names to either
        One run, or several to compare.
    best_cost : float, optional
        Lowest cost known, positive. If given, the distance to it, ``cost / best_cost − 1``, is drawn in
        place of the cost; distances below 1e-9 are drawn at 1e-9.

    Returns
    -------
    matplotlib.figure.Figure
        Not shown, not registered with pyplot. Costs that are not finite leave gaps.

    Raises
    ------
    InvalidArgument
        If there is no run, a run has no iterations, or `best_cost` is not positive and finite.
    """
    if best_cost is not None and not (math.isfinite(best_cost) and best_cost > 0):
        raise InvalidArgument(f"best_cost = {best_cost}: must be finite and positive")
    curves = _curves(runs if isinstance(runs, Mapping) else {"": runs}, best_cost)
    figure = new_figure(10, 4)
    by_iteration, by_seconds = figure.subplots(1, 2, sharey=True)
    for curve in curves:
        _draw(by_iteration, curve, curve.iteration)
        _draw(by_seconds, curve, curve.seconds)
    _finish(by_iteration, by_seconds, curves, best_cost)
    return figure


def _curves(runs: Mapping[str, Run], best_cost: float | None) -> list[_Curve]:
    if not runs:
        raise InvalidArgument("runs = {}: must hold at least one run")
    return [
        _curve(name, run, COLORS[position % len(COLORS)], best_cost)
        for position, (name, run) in enumerate(runs.items())
    ]


def _curve(name: str, run: Run, color: str, best_cost: float | None) -> _Curve:
    iterations = run.iterations if isinstance(run, Summary) else run
    if not iterations:
        raise InvalidArgument(f"runs[{name!r}]: must have at least one iteration")
    return _Curve(
        name,
        color,
        np.array([i.iteration for i in iterations]),
        np.array([i.seconds for i in iterations]),
        _heights(np.array([i.cost for i in iterations]), best_cost),
        np.array([i.accepted for i in iterations]),
    )


def _heights(cost: NDArray[np.float64], best_cost: float | None) -> NDArray[np.float64]:
    finite = np.where(np.isfinite(cost), cost, np.nan)
    return finite if best_cost is None else np.maximum(finite / best_cost - 1, SMALLEST_GAP)


def _draw(axes: Axes, curve: _Curve, at: NDArray[np.int64] | NDArray[np.float64]) -> None:
    dot = 5.0 if len(at) <= 60 else 2.5
    axes.plot(at, curve.height, color=curve.color, linewidth=1.6)
    taken, refused = curve.accepted, ~curve.accepted
    axes.plot(at[taken], curve.height[taken], "o", color=curve.color, markersize=dot)
    axes.plot(
        at[refused], curve.height[refused], "x", color=curve.color, markersize=1.4 * dot, markeredgewidth=1.6
    )


def _finish(by_iteration: Axes, by_seconds: Axes, curves: list[_Curve], best_cost: float | None) -> None:
    for axes in (by_iteration, by_seconds):
        style_axes(axes)
        axes.margins(x=0.04, y=0.1)
    # A cost of exactly zero has no place on a logarithmic scale.
    if any((curve.height > 0).any() for curve in curves):
        by_iteration.set_yscale("log", nonpositive="mask")
    by_iteration.set_xlabel("iteration")
    by_iteration.xaxis.set_major_locator(MaxNLocator(integer=True))
    by_seconds.set_xlabel("seconds")
    by_seconds.set_xlim(left=0.0)
    by_iteration.set_ylabel("cost" if best_cost is None else f"cost / best − 1   (best = {best_cost:.6g})")
    if len(curves) == 1:
        _write_last_value(by_seconds, curves[0])
    _add_legend(by_iteration, curves)


def _write_last_value(axes: Axes, curve: _Curve) -> None:
    axes.annotate(
        f"{curve.height[-1]:.6g}",
        (curve.seconds[-1], curve.height[-1]),
        xytext=(0, 8),
        textcoords="offset points",
        ha="right",
        fontsize=9,
        color=MUTED,
    )


def _add_legend(axes: Axes, curves: list[_Curve]) -> None:
    named = [curve for curve in curves if curve.name]
    handles = [Line2D([], [], color=curve.color, linewidth=1.6, label=curve.name) for curve in named]
    if any((~curve.accepted).any() for curve in curves):
        handles += [_marker("o", "accepted step"), _marker("x", "rejected step")]
    if handles:
        axes.legend(handles=handles, fontsize=9, frameon=False, loc="upper right")


def _marker(marker: str, label: str) -> Line2D:
    return Line2D([], [], color=MUTED, marker=marker, linestyle="none", markersize=5, label=label)
