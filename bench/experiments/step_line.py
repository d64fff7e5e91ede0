"""Geometric and algebraic cost along the step (thesis figure 4.1)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.report import Report
from experiments.runs import FloatArray
from experiments.step_trace import COLUMNS, COST_NOTE, IDENTITY, TracedStep, sampled_lengths, traced_steps
from sfmcpp.study.plotting.style import COLORS, new_figure, style_axes

NOTES = (
    "One run of LM without line search. geometric, algebraic: the length α of the least such cost.",
    COST_NOTE,
)
GEOMETRIC, ALGEBRAIC = COLORS[0], COLORS[1]


def costs_along_steps(experiment: Experiment) -> Report:
    """Evaluate both costs along the first steps of one run."""
    alphas = sampled_lengths(experiment)
    steps = list(traced_steps(experiment))
    rows = [_row(step, alphas) for step in steps]
    return Report(NOTES, IDENTITY, COLUMNS, rows, _picture(steps, rows, alphas))


def common(alphas: FloatArray) -> FloatArray:
    """The same length for cameras and points."""
    return np.stack([alphas, alphas], axis=1)


def _row(step: TracedStep, alphas: FloatArray) -> Row:
    geometric, algebraic = _minima(step, alphas)
    row = step.row((algebraic, algebraic), (geometric, geometric))
    return {**row, "geometric": geometric, "algebraic": algebraic}


def _minima(step: TracedStep, alphas: FloatArray) -> tuple[float, float]:
    """The sampled length of least true cost, and the root of least algebraic cost."""
    explored = step.explore(common(alphas))
    roots = np.array(explored.lengths)
    at_roots = step.explore(common(roots)).algebraic
    return float(alphas[np.argmin(explored.geometric)]), float(roots[np.argmin(at_roots)])


def _picture(steps: list[TracedStep], rows: list[Row], alphas: FloatArray) -> Figure:
    models = list(dict.fromkeys(step.camera_model for step in steps))
    columns = max(step.iteration for step in steps)
    figure = new_figure(2.3 * columns, 2.5 * len(models))
    panels = figure.subplots(len(models), columns, squeeze=False)
    for step, row in zip(steps, rows, strict=True):
        _draw(panels[models.index(step.camera_model), step.iteration - 1], step, row, alphas)
    figure.supxlabel("length α of the step", fontsize=10)
    figure.supylabel("cost, scaled: least 0, at α = 0 or 1 at most 1", fontsize=10)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=4, fontsize=9, frameon=False)
    return figure


def _draw(axes: Axes, step: TracedStep, row: Row, alphas: FloatArray) -> None:
    explored = step.explore(common(alphas))
    ends = step.explore(common(np.array([0.0, 1.0])))
    axes.plot(alphas, _scaled(explored.geometric, ends.geometric), color=GEOMETRIC, label="geometric cost")
    axes.plot(alphas, _scaled(explored.algebraic, ends.algebraic), color=ALGEBRAIC, label="algebraic cost")
    for name, color in (("geometric", GEOMETRIC), ("algebraic", ALGEBRAIC)):
        axes.axvline(row[name], color=color, linestyle="--", linewidth=1, label=f"least {name} cost")
    axes.axvline(1, color="0.6", linewidth=0.8)
    axes.set_xlim(alphas[0], alphas[-1])
    axes.set_ylim(-0.1, 1.6)
    axes.set_title(f"{step.camera_model}, iteration {step.iteration}", fontsize=9)
    style_axes(axes)


def _scaled(costs: FloatArray, ends: FloatArray) -> FloatArray:
    least = float(costs.min())
    return (costs - least) / (float(ends.max()) - least)
