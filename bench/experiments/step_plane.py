"""Geometric and algebraic cost over the two lengths of the step (thesis figure 4.2)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.report import Report
from experiments.runs import FloatArray
from experiments.step_trace import COLUMNS, COST_NOTE, IDENTITY, TracedStep, sampled_lengths, traced_steps
from sfmcpp.study.plotting.style import COLORS, new_figure

NOTES = (
    "One run of LM without line search. geometric, algebraic: the lengths αP αQ of the least such cost.",
    COST_NOTE,
)
MARKS = (("unit", "s", "white", 10), ("geometric", "o", COLORS[0], 8), ("algebraic", "^", COLORS[1], 5.5))


def costs_over_lengths(experiment: Experiment) -> Report:
    """Evaluate both costs over the two lengths of the first steps of one run."""
    alphas = sampled_lengths(experiment)
    steps = list(traced_steps(experiment))
    rows = [_row(step, alphas) for step in steps]
    return Report(NOTES, IDENTITY, COLUMNS, rows, _picture(steps, rows, alphas))


def _grid(alphas: FloatArray) -> FloatArray:
    """(n², 2) pairs, the length of the cameras varying fastest."""
    camera, point = np.meshgrid(alphas, alphas)
    return np.stack([camera.ravel(), point.ravel()], axis=1)


def _row(step: TracedStep, alphas: FloatArray) -> Row:
    geometric, algebraic = _minima(step, alphas)
    row = step.row(algebraic, geometric)
    return {**row, "unit": [1.0, 1.0], "geometric": list(geometric), "algebraic": list(algebraic)}


def _minima(step: TracedStep, alphas: FloatArray) -> tuple[tuple[float, float], tuple[float, float]]:
    """The sampled pair of least true cost, and the stationary pair of least algebraic cost."""
    grid = _grid(alphas)
    explored = step.explore(grid)
    pairs = np.array(explored.pairs)
    at_pairs = step.explore(pairs).algebraic
    return _pair(grid[np.argmin(explored.geometric)]), _pair(pairs[np.argmin(at_pairs)])


def _pair(values: FloatArray) -> tuple[float, float]:
    return float(values[0]), float(values[1])


def _picture(steps: list[TracedStep], rows: list[Row], alphas: FloatArray) -> Figure:
    figure = new_figure(2.6 * len(steps), 5.8)
    panels = figure.subplots(2, len(steps), sharex=True, sharey=True, squeeze=False)
    for column, (step, row) in enumerate(zip(steps, rows, strict=True)):
        explored = step.explore(_grid(alphas))
        _draw(panels[0, column], explored.geometric, row, alphas)
        _draw(panels[1, column], explored.algebraic, row, alphas)
        panels[0, column].set_title(f"{step.camera_model}, iteration {step.iteration}", fontsize=9)
        panels[1, column].set_xlabel("length of the cameras αP", fontsize=9)
    panels[0, 0].set_ylabel("geometric cost\nlength of the points αQ", fontsize=9)
    panels[1, 0].set_ylabel("algebraic cost\nlength of the points αQ", fontsize=9)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    return figure


def _draw(axes: Axes, costs: FloatArray, row: Row, alphas: FloatArray) -> None:
    height = np.log10(costs / costs.min()).reshape(len(alphas), len(alphas))
    levels = np.linspace(0, np.quantile(height, 0.8), 16)
    axes.contourf(alphas, alphas, height, levels=levels, cmap="Greys_r", extend="max")
    axes.plot([alphas[0], alphas[-1]], [alphas[0], alphas[-1]], color="0.5", linewidth=0.7)
    for name, marker, color, size in MARKS:
        label = "unit length" if name == "unit" else f"least {name} cost"
        axes.plot(*row[name], marker, color=color, markeredgecolor="black", markersize=size, label=label)
    axes.set_xlim(alphas[0], alphas[-1])
    axes.set_ylim(alphas[0], alphas[-1])
    axes.set_aspect("equal")
    axes.tick_params(labelsize=8)
