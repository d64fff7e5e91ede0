"""From how far away the global minimum is reached: the study that the thesis asks for."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

import sfmcpp
from experiments.description import Experiment, Row
from experiments.measures import mean, steps_tried
from experiments.pictures import figure_legend, line_style
from experiments.report import Report
from experiments.runs import Run, StartKey, camera_models, select, solve_in_turn
from experiments.starts import Start, in_model, noisy_scene, true_scene
from sfmcpp.study.plotting.style import new_figure, style_axes

REACHED_WITHIN = 0.01
NOTES = (
    "reached: the final cost is within 1 % of that reached from the truth; standard_error is binomial.",
    "level: multiplies all three standard deviations of the described noise; every level has the same seeds.",
    "mean_iterations: over the runs that reached it.",
)
COLUMNS = ("camera_model", "level", "label", "runs", "share", "standard_error", "mean_iterations")


def basin_of_convergence(experiment: Experiment) -> Report:
    """Run every method from starts at every level of noise and count who reaches the global minimum."""
    global_costs = _global_costs(experiment)
    rows = []
    for level in experiment.settings["levels"]:
        runs = solve_in_turn(_starts(experiment, level), experiment.solve_options())
        rows += _rows(runs, level, experiment.methods, global_costs)
    rows.sort(key=lambda row: str(row["camera_model"]))
    return Report(NOTES, ("label", "camera_model", "level"), COLUMNS, rows, _picture(rows, experiment))


def _starts(experiment: Experiment, level: float) -> Iterator[Start]:
    noise = {name: level * sigma for name, sigma in experiment.noise[0].items()}
    for seed in experiment.seeds:
        problem = noisy_scene(experiment, noise, seed)
        for model in experiment.camera_models:
            yield Start("scene", seed, in_model(problem, model))


def _global_costs(experiment: Experiment) -> dict[StartKey, float]:
    costs = {}
    for seed in experiment.seeds:
        truth = true_scene(experiment, seed)
        for model in experiment.camera_models:
            problem = in_model(truth.copy(), model)
            summary = sfmcpp.solve(problem, max_iterations=200, function_tolerance=1e-9, threads=1)
            costs["scene", problem.camera_model, seed] = summary.final_cost
    return costs


def _rows(runs: list[Run], level: float, labels: list[str], global_costs: dict[StartKey, float]) -> list[Row]:
    return [
        _row(select(runs, label, model), level, global_costs)
        for model in camera_models(runs)
        for label in labels
    ]


def _row(runs: list[Run], level: float, global_costs: dict[StartKey, float]) -> Row:
    reached = [
        run for run in runs if run.summary.final_cost <= (1 + REACHED_WITHIN) * global_costs[run.start]
    ]
    share = len(reached) / len(runs)
    return {
        "label": runs[0].label,
        "method": runs[0].summary.method,
        "line_search": runs[0].summary.line_search,
        "camera_model": runs[0].camera_model,
        "level": level,
        "runs": len(runs),
        "reached": len(reached),
        "share": share,
        "standard_error": float(np.sqrt(share * (1 - share) / len(runs))),
        "mean_iterations": mean(steps_tried(run) for run in reached),
    }


def _picture(rows: list[Row], experiment: Experiment) -> Figure:
    models = list(dict.fromkeys(row["camera_model"] for row in rows))
    figure = new_figure(5.4 * len(models), 4.6)
    panels = figure.subplots(1, len(models), sharey=True, squeeze=False)[0]
    for axes, model in zip(panels, models, strict=True):
        for number, label in enumerate(experiment.methods):
            _draw(
                axes,
                [r for r in rows if (r["camera_model"], r["label"]) == (model, label)],
                0.012 * (number - (len(experiment.methods) - 1) / 2),
            )
        axes.set_title(model, fontsize=10)
        axes.set_xlabel(_noise_label(experiment))
    panels[0].set_ylabel("share of runs that reach the global minimum")
    figure_legend(panels[0], len(experiment.methods))
    return figure


def _draw(axes: Axes, rows: list[Row], offset: float) -> None:
    levels = [row["level"] + offset for row in rows]
    shares, errors = [row["share"] for row in rows], [row["standard_error"] for row in rows]
    axes.errorbar(levels, shares, errors, capsize=2, markersize=4, **line_style(rows[0]["label"]))
    style_axes(axes)


def _noise_label(experiment: Experiment) -> str:
    noise = experiment.noise[0]
    return (
        f"initial noise, in multiples of {noise['point_sigma_m']:g} m (points), "
        f"{noise['position_sigma_m']:g} m and {noise['rotation_sigma_deg']:g}° (cameras)"
    )
