"""How often the lengths of an algebraic line search are taken (thesis table 4.2)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.pictures import figure_legend, line_style
from experiments.report import Report
from experiments.runs import Run, select, solve_in_turn
from experiments.starts import real_starts, synthetic_starts
from sfmcpp.ba import Iteration
from sfmcpp.study.plotting.style import new_figure, style_axes

STEPS = 6
NOTES = (
    "percent: of the searches of this iteration, those whose accepted step has another length than one.",
    "percent_of_all: the same of all runs, those that had ended before included.",
    "standard_error is of percent. Synthetic and real problems, as they are and made projective.",
)
COLUMNS = (
    "problems",
    "label",
    "iteration",
    "runs",
    "searched",
    "percent",
    "standard_error",
    "percent_of_all",
)
GROUPS = ("all", "synthetic", "real")
UNIT = (1.0, 1.0)


def acceptance_rate(experiment: Experiment) -> Report:
    """Run the algebraic searches from synthetic and real starts and count."""
    synthetic = solve_in_turn(synthetic_starts(experiment), experiment.solve_options())
    real = solve_in_turn(real_starts(experiment), experiment.solve_options())
    runs_of = dict(zip(GROUPS, (synthetic + real, synthetic, real), strict=True))
    rows = [
        {"problems": group, **_row(select(runs, label), label, step)}
        for group, runs in runs_of.items()
        for label in experiment.methods
        for step in range(1, STEPS + 1)
    ]
    return Report(NOTES, ("problems", "label", "iteration"), COLUMNS, rows, _picture(rows, experiment))


def length_is_taken(iteration: Iteration) -> bool:
    """Whether an accepted step went another length than one."""
    return iteration.accepted and iteration.step_lengths != UNIT


def _row(runs: list[Run], label: str, step: int) -> Row:
    iterations = [run.summary.iterations[step] for run in runs if len(run.summary.iterations) > step]
    searched = [iteration for iteration in iterations if iteration.line_searched]
    taken = sum(length_is_taken(iteration) for iteration in searched)
    return {
        "label": label,
        "iteration": step,
        "runs": len(runs),
        "searched": len(searched),
        "percent": 100 * taken / len(searched) if searched else None,
        "standard_error": _standard_error_percent(taken, len(searched)),
        "percent_of_all": 100 * taken / len(runs),
    }


def _standard_error_percent(taken: int, count: int) -> float | None:
    if count == 0:
        return None
    share = taken / count
    return 100 * float(np.sqrt(share * (1 - share) / count))


def _picture(rows: list[Row], experiment: Experiment) -> Figure:
    figure = new_figure(12, 4.2)
    panels = figure.subplots(1, len(GROUPS), sharey=True)
    for axes, group in zip(panels, GROUPS, strict=True):
        for label in experiment.methods:
            _draw_ours(axes, label, _of(rows, group, label))
            _draw_thesis(axes, label, _of(experiment.thesis, group, label))
        style_axes(axes)
        axes.set_xlabel("iteration")
        axes.set_title(f"{group} problems", fontsize=10)
    panels[0].set_ylabel("lengths taken, percent of the searches")
    panels[0].set_ylim(0, 105)
    figure_legend(panels[0], 4)
    return figure


def _of(rows: list[Row], group: str, label: str) -> list[Row]:
    return [row for row in rows if (row["problems"], row["label"]) == (group, label)]


def _draw_ours(axes: Axes, label: str, rows: list[Row]) -> None:
    searched = [row for row in rows if row["searched"]]
    steps, percent = [row["iteration"] for row in searched], [row["percent"] for row in searched]
    errors = [row["standard_error"] for row in searched]
    axes.errorbar(steps, percent, errors, capsize=3, markersize=4, **line_style(label))


def _draw_thesis(axes: Axes, label: str, rows: list[Row]) -> None:
    style = line_style(label) | {"label": f"{label}, thesis", "linestyle": ":", "marker": "s"}
    axes.plot([row["iteration"] for row in rows], [row["percent"] for row in rows], markersize=4, **style)
