"""Algebraic searches for cameras with distortion and free focal length, up to a thousand cameras."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.measures import best_costs, cost_evaluations, steps_to, steps_tried
from experiments.pictures import figure_legend, line_style
from experiments.report import Report
from experiments.runs import FloatArray, Run, solve_in_turn
from experiments.starts import Start, real_starts, synthetic_starts
from sfmcpp.study.plotting.style import new_figure, style_axes

FLOOR = 1e-7
NOTES = (
    "above_best: final cost over the best of all methods on the problem, minus one.",
    "…_to_1e-3: until within 1e-3 of that best; a dash if never. taken: steps of another length than one.",
)
COLUMNS = (
    "problem",
    "label",
    "iterations",
    "taken",
    "final_cost",
    "above_best",
    "iterations_to_1e-3",
    "seconds_to_1e-3",
    "seconds",
    "cost_evaluations",
)


def searches_at_scale(experiment: Experiment) -> Report:
    """Solve the large scene and the real problems by every method."""
    starts = [*real_starts(experiment), *synthetic_starts(experiment)]
    named = [Start(_title(start), start.seed, start.problem) for start in starts]
    runs = solve_in_turn(named, experiment.solve_options())
    best = best_costs(runs)
    order = [start.name for start in named]
    runs.sort(key=lambda run: (order.index(run.start[0]), experiment.methods.index(run.label)))
    rows = [_row(run, best[run.start]) for run in runs]
    return Report(NOTES, ("problem", "label"), COLUMNS, rows, _picture(runs, order, best))


def _title(start: Start) -> str:
    return f"{start.name.partition(',')[0]}, {start.problem.num_cameras} cameras"


def _row(run: Run, best: float) -> Row:
    iterations = run.summary.iterations
    steps = steps_to(run, 1.001 * best)
    return {
        "problem": run.start[0],
        "label": run.label,
        "method": run.summary.method,
        "line_search": run.summary.line_search,
        "camera_model": run.camera_model,
        "iterations": steps_tried(run),
        "taken": sum(i.accepted and i.step_lengths != (1.0, 1.0) for i in iterations),
        "final_cost": run.summary.final_cost,
        "above_best": run.summary.final_cost / best - 1,
        "iterations_to_1e-3": steps,
        "seconds_to_1e-3": None if steps is None else iterations[steps].seconds,
        "seconds": run.summary.seconds_total,
        "cost_evaluations": cost_evaluations(run),
    }


def _picture(runs: list[Run], order: list[str], best: dict[tuple[str, str, int], float]) -> Figure:
    figure = new_figure(11, 3.6 * len(order))
    panels = figure.subplots(len(order), 2, sharey="row", squeeze=False)
    for (by_iteration, by_seconds), name in zip(panels, order, strict=True):
        for run in (run for run in runs if run.start[0] == name):
            excess = np.maximum(run.costs / best[run.start] - 1, FLOOR)
            _draw(by_iteration, np.arange(float(len(excess))), excess, run.label)
            _draw(by_seconds, np.array([i.seconds for i in run.summary.iterations]), excess, run.label)
        by_iteration.set_title(name, fontsize=10, loc="left")
        by_iteration.set_ylabel("cost / best − 1")
    panels[-1, 0].set_xlabel("iteration")
    panels[-1, 1].set_xlabel("seconds")
    figure_legend(panels[0, 0], 4)
    return figure


def _draw(axes: Axes, at: FloatArray, excess: FloatArray, label: str) -> None:
    axes.plot(at, excess, markersize=3, linewidth=1, **line_style(label))
    axes.set_yscale("log")
    style_axes(axes)
