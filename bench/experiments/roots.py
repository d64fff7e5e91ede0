"""How many lengths an algebraic line search proposes (thesis table 4.3)."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.pictures import line_style
from experiments.report import Report
from experiments.runs import Run, select, solve_in_turn
from experiments.starts import real_starts, synthetic_starts
from sfmcpp.study.plotting.style import new_figure, style_axes

MOST_ROOTS = 5
NOTES = (
    "roots: real roots of the cubic (G-ALS) or the quintic (T-ALS) of one search; a double root counts once.",
    "percent: of all searches in the first iterations of all runs, synthetic and real.",
)
COLUMNS = ("label", "roots", "count", "percent")


def number_of_roots(experiment: Experiment) -> Report:
    """Run the algebraic searches from synthetic and real starts and count their proposals."""
    starts = [*synthetic_starts(experiment), *real_starts(experiment)]
    runs = solve_in_turn(starts, experiment.solve_options())
    rows = [row for label in experiment.methods for row in _rows(select(runs, label), label)]
    return Report(NOTES, ("label", "roots"), COLUMNS, rows, _picture(rows, experiment))


def _rows(runs: list[Run], label: str) -> list[Row]:
    numbers = [
        len(iteration.proposed_lengths)
        for run in runs
        for iteration in run.summary.iterations
        if iteration.line_searched
    ]
    counts = np.bincount(numbers, minlength=MOST_ROOTS + 1)
    return [
        {
            "label": label,
            "roots": roots,
            "count": int(counts[roots]),
            "percent": 100 * float(counts[roots]) / len(numbers),
        }
        for roots in range(len(counts))
        if roots > 0 or counts[0] > 0
    ]


def _picture(rows: list[Row], experiment: Experiment) -> Figure:
    figure = new_figure(8.5, 4.0)
    axes = figure.subplots()
    bars = [
        (label, rows_of, suffix, alpha)
        for label in experiment.methods
        for rows_of, suffix, alpha in ((rows, "", 1.0), (experiment.thesis, ", thesis", 0.4))
    ]
    for number, (label, rows_of, suffix, alpha) in enumerate(bars):
        style = {"color": line_style(label)["color"], "alpha": alpha, "label": label + suffix}
        _draw(axes, [row for row in rows_of if row["label"] == label], 0.22 * (number - 1.5), style)
    style_axes(axes)
    axes.set_xlabel("real roots of one search")
    axes.set_ylabel("percent of the searches")
    axes.set_ylim(0, 110)
    axes.legend(fontsize=9, frameon=False)
    return figure


def _draw(axes: Axes, rows: list[Row], shift: float, style: dict[str, Any]) -> None:
    at = [row["roots"] + shift for row in rows]
    bars = axes.bar(at, [row["percent"] for row in rows], 0.2, **style)
    axes.bar_label(bars, fmt="%.1f", fontsize=7, padding=2)
