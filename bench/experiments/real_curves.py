"""RMS over time and over iterations, from real starts (thesis figures 4.12 and 4.14)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.factorised import factorised_starts
from experiments.keyframe_starts import keyframe_starts
from experiments.measures import steps_tried
from experiments.pictures import figure_legend, line_style
from experiments.report import Report
from experiments.runs import Run, solve_in_turn
from sfmcpp.study.plotting.style import new_figure, style_axes

STEPS = 6
NOTES = (
    "rms_k: sqrt(Σ‖r‖² / 2M) after k steps, rejected ones included [px]; a run that has ended stays.",
    "iterations, seconds: until the stopping rule, one thread, methods in turn.",
)
COLUMNS = (
    "problem",
    "camera_model",
    "label",
    "cameras",
    "free",
    "points",
    *(f"rms_{k}" for k in range(STEPS + 1)),
    "rms_final",
    "iterations",
    "seconds",
)


def rms_from_real_starts(experiment: Experiment) -> Report:
    """Run every method from every start and follow the RMS."""
    starts = [*factorised_starts(experiment), *keyframe_starts(experiment)]
    runs = solve_in_turn(starts, experiment.solve_options())
    sizes = {
        (start.name, start.problem.camera_model): {
            "cameras": start.problem.num_cameras,
            "free": int(np.count_nonzero(~start.problem.fixed_cameras)),
            "points": start.problem.num_points,
        }
        for start in starts
    }
    order = list(sizes)
    runs.sort(key=lambda run: (order.index(run.start[:2]), experiment.methods.index(run.label)))
    rows = [{**_row(run), **sizes[run.start[:2]]} for run in runs]
    return Report(NOTES, ("problem", "label", "camera_model"), COLUMNS, rows, _picture(runs, order))


def _row(run: Run) -> Row:
    rms = _rms(run)
    followed = rms[np.minimum(np.arange(STEPS + 1), len(rms) - 1)]
    return {
        "problem": run.start[0],
        "camera_model": run.camera_model,
        "label": run.label,
        "method": run.summary.method,
        "line_search": run.summary.line_search,
        **{f"rms_{k}": float(value) for k, value in enumerate(followed)},
        "rms_final": run.summary.final_rms_px,
        "iterations": steps_tried(run),
        "seconds": run.summary.seconds_total,
    }


def _rms(run: Run) -> np.ndarray:
    """RMS after each step [px], from the costs of solves without a robust loss."""
    return np.asarray(run.summary.initial_rms_px * np.sqrt(run.costs / run.costs[0]))


def _picture(runs: list[Run], order: list[tuple[str, str]]) -> Figure:
    figure = new_figure(4.6 * len(order), 7.0)
    panels = figure.subplots(2, len(order), squeeze=False)
    for (by_seconds, by_iteration), (name, model) in zip(panels.T, order, strict=True):
        for run in (run for run in runs if run.start[:2] == (name, model)):
            seconds = [iteration.seconds for iteration in run.summary.iterations]
            _draw(by_seconds, seconds, run)
            _draw(by_iteration, list(range(len(seconds))), run)
        by_iteration.set_xlim(-0.3, 2 * STEPS + 0.3)
        by_seconds.set_title(f"{name}, {model}", fontsize=10)
        by_seconds.set_xlabel("seconds")
        by_iteration.set_xlabel("iteration")
    panels[0, 0].set_ylabel("RMS [px]")
    panels[1, 0].set_ylabel("RMS [px]")
    figure_legend(panels[0, 0], 5)
    return figure


def _draw(axes: Axes, at: list[float], run: Run) -> None:
    axes.plot(at, _rms(run), markersize=3, linewidth=1, **line_style(run.label))
    axes.set_yscale("log")
    style_axes(axes)
