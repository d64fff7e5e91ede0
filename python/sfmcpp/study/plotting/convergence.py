"""Convergence: cost over iterations and over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from sfmcpp.ba import Iteration, Summary
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import checked
from sfmcpp.study.plotting.style import COLORS, MUTED, as_label, new_figure, style_axes

Run = Summary | Sequence[Iteration]

# Distances to the lowest cost, as a share of it, below this are rounding, and drawn here.
SMALLEST_GAP = 1e-9
# The lowest cost itself, which has no place on a logarithmic scale, is drawn this far below the next one.
_BELOW_THE_NEXT = 0.3
# Of runs with one colour, as there are more runs than colours.
_DASHES: tuple[Literal["-"], Literal["--"], Literal[":"], Literal["-."]] = ("-", "--", ":", "-.")
# A longer legend hides curves, and stands beside them.
_MOST_INSIDE = 8


@dataclass(frozen=True)
class _Curve:
    name: str
    color: str
    dash: Literal["-", "--", ":", "-."]
    cost: NDArray[np.float64]
    iteration: NDArray[np.int64]
    seconds: NDArray[np.float64]
    height: NDArray[np.float64]
    lowest: NDArray[np.bool_]
    accepted: NDArray[np.bool_]


@checked()
def plot_convergence(
    runs: Run | Mapping[str, Run], *, best_cost: float | None = None, title: str = ""
) -> Figure:
    """Plot the relative excess cost over the lowest cost, by iteration and time, on a logarithmic scale.

    A dot is an accepted step, a cross a rejected one; an open dot is at the lowest cost or within 1e-9 of it,
    and stands below all others, wherever that is. If every cost is zero or none is finite, the
    costs themselves are drawn.

    Parameters
    ----------
    runs : Summary, sequence of Iteration, or mapping of names to either
        One run, or several to compare.
    best_cost : float, optional
        Lowest cost known, positive. Default: the lowest of the runs, which is drawn a little below
        all others. Drawn is the distance to it, ``cost / best_cost − 1``; below 1e-9 at 1e-9.
    title : str
        Title of the figure. Default: what was minimised, and from where to where.

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
    named = runs if isinstance(runs, Mapping) else {"": runs}
    if not named:
        raise InvalidArgument("runs = {}: must hold at least one run")
    costs = [_costs(name, run) for name, run in named.items()]
    best = _lowest(costs) if best_cost is None else best_cost
    edge = SMALLEST_GAP if best_cost is not None else _display_minimum(costs, best)
    curves = [
        _curve(*run, cost, position, _drawn_costs(cost, best, edge), -1.0 if best is None else edge)
        for position, (run, cost) in enumerate(zip(named.items(), costs, strict=True))
    ]
    figure = new_figure(10, 4)
    figure.suptitle(title or _title(curves), fontsize=11)
    by_iteration, by_seconds = figure.subplots(1, 2, sharey=True)
    for curve in curves:
        _draw(by_iteration, curve, curve.iteration)
        _draw(by_seconds, curve, curve.seconds)
    _finish(by_iteration, by_seconds, curves, best)
    return figure


def _iterations(run: Run) -> Sequence[Iteration]:
    return run.iterations if isinstance(run, Summary) else run


def _costs(name: str, run: Run) -> NDArray[np.float64]:
    """Costs of a run, not a number where they are not finite."""
    cost = np.array([i.cost for i in _iterations(run)])
    if not len(cost):
        raise InvalidArgument(f"runs[{name!r}]: must have at least one iteration")
    return np.where(np.isfinite(cost), cost, np.nan)


def _lowest(costs: Sequence[NDArray[np.float64]]) -> float | None:
    """The lowest cost of all; None if there is none that others can be a multiple of."""
    lowest = min((float(c) for cost in costs for c in cost if c == c), default=0.0)
    return lowest if lowest > 0 else None


def _display_minimum(costs: Sequence[NDArray[np.float64]], best: float | None) -> float:
    """Height at which the lowest cost is drawn."""
    gaps = np.concatenate(costs) / (best or 1.0) - 1
    return _BELOW_THE_NEXT * min(gaps[gaps > SMALLEST_GAP].tolist(), default=1.0)


def _drawn_costs(cost: NDArray[np.float64], best: float | None, edge: float) -> NDArray[np.float64]:
    return cost if best is None else np.maximum(cost / best - 1, edge)


def _curve(
    name: str, run: Run, cost: NDArray[np.float64], position: int, height: NDArray[np.float64], edge: float
) -> _Curve:
    iterations = _iterations(run)
    return _Curve(
        as_label(name),
        COLORS[position % len(COLORS)],
        _DASHES[position // len(COLORS) % len(_DASHES)],
        cost,
        np.array([i.iteration for i in iterations]),
        np.array([i.seconds for i in iterations]),
        height,
        height <= edge,
        np.array([i.accepted for i in iterations]),
    )


def _title(curves: Sequence[_Curve]) -> str:
    if len(curves) > 1:
        return "Excess cost of each run over the lowest cost"
    (curve,) = curves
    of = f"{curve.name}: " if curve.name else ""
    count = int(curve.iteration[-1])
    return f"{of}cost {curve.cost[0]:.6g} → {curve.cost[-1]:.6g} in {count} iteration{'s' * (count != 1)}"


def _draw(axes: Axes, curve: _Curve, at: NDArray[np.int64] | NDArray[np.float64]) -> None:
    dot = 5.0 if len(at) <= 60 else 2.5
    axes.plot(at, curve.height, color=curve.color, linestyle=curve.dash, linewidth=1.6)
    taken, refused = curve.accepted, ~curve.accepted
    for which, face in ((taken & ~curve.lowest, curve.color), (taken & curve.lowest, "white")):
        axes.plot(at[which], curve.height[which], "o", color=curve.color, mfc=face, markersize=dot)
    axes.plot(
        at[refused], curve.height[refused], "x", color=curve.color, markersize=1.4 * dot, markeredgewidth=1.6
    )


def _finish(by_iteration: Axes, by_seconds: Axes, curves: list[_Curve], best: float | None) -> None:
    for axes in (by_iteration, by_seconds):
        style_axes(axes)
        axes.margins(x=0.04, y=0.1)
    # A cost of exactly zero has no place on a logarithmic scale.
    if any((curve.height > 0).any() for curve in curves):
        by_iteration.set_yscale("log", nonpositive="mask")
    by_iteration.set_xlabel("iteration")
    by_iteration.xaxis.set_major_locator(MaxNLocator(integer=True))
    by_seconds.set_xlabel("time [s]")
    by_seconds.xaxis.set_major_locator(MaxNLocator(5))  # as 0.0175 is wide
    by_seconds.set_xlim(left=0.0)
    by_iteration.set_ylabel("cost" if best is None else f"(cost − {best:.6g}) / {best:.6g}")
    _add_legend(by_iteration, by_seconds, curves)


def _add_legend(left: Axes, right: Axes, curves: list[_Curve]) -> None:
    named = [curve for curve in curves if curve.name and len(curves) > 1]
    handles = [
        Line2D([], [], color=curve.color, linestyle=curve.dash, linewidth=1.6, label=curve.name)
        for curve in named
    ]
    if any((~curve.accepted).any() for curve in curves):
        handles += [_marker("o", "accepted step"), _marker("x", "rejected step")]
    if handles and any((curve.lowest & curve.accepted).any() for curve in curves):
        handles.append(_marker("o", f"within {SMALLEST_GAP:g} of the lowest", "white"))
    if len(handles) > _MOST_INSIDE:
        right.legend(handles=handles, fontsize=9, frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    elif handles:
        left.legend(handles=handles, fontsize=9, frameon=False, loc="upper right")


def _marker(marker: str, label: str, face: str = MUTED) -> Line2D:
    return Line2D([], [], color=MUTED, marker=marker, mfc=face, linestyle="none", markersize=5, label=label)
