"""Mean iterations and time to converge (thesis table 4.1)."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.measures import (
    best_costs,
    cost_evaluations,
    has_converged,
    mean,
    standard_error,
    steps_to,
    steps_to_own_minimum,
    steps_tried,
)
from experiments.report import Report
from experiments.runs import Run, StartKey, camera_models, select, solve_in_turn
from experiments.starts import synthetic_starts
from sfmcpp.study.plotting.style import COLORS, new_figure, style_axes

NOTES = (
    "converged: the final cost is within 1 % of the best of all methods; the means are of these runs.",
    "mean_iterations: steps tried until the stopping rule, rejected ones included.",
    "…_to_1e-3: until within 1e-3 of the best of all; …_to_minimum: until within 1e-6 of the run's own end.",
    "mean_seconds: until the stopping rule, set-up included, one thread, methods in turn.",
    "…over_LM: over those of LM, in the common runs, in which all methods converged.",
    "The thesis has one table for calibrated and projective runs.",
)
COLUMNS = (
    "camera_model",
    "label",
    "runs",
    "converged",
    "mean_iterations",
    "standard_error",
    "mean_iterations_to_1e-3",
    "mean_iterations_to_minimum",
    "mean_cost_evaluations",
    "mean_seconds",
    "common",
    "over_LM",
    "to_minimum_over_LM",
)


def mean_convergence(experiment: Experiment) -> Report:
    """Run every method from every start and average."""
    runs = solve_in_turn(synthetic_starts(experiment), experiment.solve_options())
    rows = convergence_rows(runs, experiment.methods)
    return Report(NOTES, ("label", "camera_model"), COLUMNS, rows, _picture(rows, experiment))


def convergence_rows(runs: list[Run], labels: list[str]) -> list[Row]:
    """One row per camera model and method."""
    best = best_costs(runs)
    common = {run.start for run in runs} - {run.start for run in runs if not has_converged(run, best)}
    return [
        row
        for model in camera_models(runs)
        for row in _over_first([_row(select(runs, label, model), best, common) for label in labels])
    ]


def _over_first(rows: list[Row]) -> list[Row]:
    """Compare the methods of one camera model with the first of them."""
    for row in rows:
        row["over_LM"] = _ratio(row, rows[0], "mean_iterations_common")
        row["to_minimum_over_LM"] = _ratio(row, rows[0], "mean_iterations_to_minimum_common")
    return rows


def _row(runs: list[Run], best: Mapping[StartKey, float], common: set[StartKey]) -> Row:
    converged = [run for run in runs if has_converged(run, best)]
    shared = [run for run in runs if run.start in common]
    summary = runs[0].summary
    return {
        "label": runs[0].label,
        "method": summary.method,
        "line_search": summary.line_search,
        "camera_model": runs[0].camera_model,
        "runs": len(runs),
        "converged": len(converged),
        "mean_iterations": mean(steps_tried(run) for run in converged),
        "standard_error": standard_error(steps_tried(run) for run in converged),
        "mean_iterations_to_1e-3": mean(steps_to(run, 1.001 * best[run.start]) for run in converged),
        "mean_iterations_to_minimum": mean(steps_to_own_minimum(run) for run in converged),
        "common": len(shared),
        "mean_iterations_common": mean(steps_tried(run) for run in shared),
        "mean_iterations_to_minimum_common": mean(steps_to_own_minimum(run) for run in shared),
        "mean_cost_evaluations": mean(cost_evaluations(run) for run in converged),
        "mean_seconds": mean(run.summary.seconds_total for run in converged),
    }


def _ratio(row: Row, reference: Row, column: str) -> float | None:
    """None where one of them has no value."""
    value, unit = row.get(column), reference.get(column)
    return value / unit if value is not None and unit else None


def _picture(rows: list[Row], experiment: Experiment) -> Figure:
    """Iterations and time of each method over those of LM, ours and the thesis'."""
    groups = _by_label([*rows, *map(_drawn_thesis, experiment.thesis)])
    figure = new_figure(11, 4.6)
    by_iterations, by_seconds = figure.subplots(1, 2, sharey=True)
    _bars(by_iterations, groups, experiment.methods, "mean_iterations_common")
    _bars(by_seconds, groups, experiment.methods, "mean_seconds")
    by_iterations.set_xlabel("mean iterations in the common runs, over those of LM")
    by_seconds.set_xlabel("mean seconds, over those of LM")
    by_iterations.invert_yaxis()
    by_seconds.legend(fontsize=9, frameon=False)
    return figure


def _drawn_thesis(row: Row) -> Row:
    return {**row, "camera_model": "thesis", "mean_iterations_common": row["mean_iterations"]}


def _by_label(rows: list[Row]) -> dict[str, dict[str, Row]]:
    groups: dict[str, dict[str, Row]] = {}
    for row in rows:
        groups.setdefault(row["camera_model"], {})[row["label"]] = row
    return groups


def _bars(axes: Axes, groups: Mapping[str, Mapping[str, Row]], labels: list[str], column: str) -> None:
    height = 0.8 / len(groups)
    for number, (name, rows) in enumerate(groups.items()):
        ratios = [_ratio(rows.get(label, {}), rows[labels[0]], column) or np.nan for label in labels]
        at = np.arange(len(labels)) + (number - (len(groups) - 1) / 2) * height
        axes.barh(at, ratios, 0.9 * height, color=COLORS[number], label=name)
    style_axes(axes)
    axes.axvline(1, color="0.3", linewidth=0.8)
    axes.set_yticks(np.arange(len(labels)), labels)
