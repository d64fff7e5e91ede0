"""One drive along its way: paths, errors, scale and weights (thesis figures 5.13–5.16 and 5.24)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment
from experiments.drives import MEASURES, RATIOS, Run, report_of, runs_of
from experiments.report import Report
from experiments.summaries import summaries
from sfmcpp.model.arrays import FloatArray
from sfmcpp.study.plotting.style import COLORS, new_figure, style_axes


def courses_of_drives(experiment: Experiment) -> Report:
    """Every line on every drive, and pictures of the first one."""
    runs = runs_of(experiment)
    rows = [run.row for run in runs]
    drawn = [run for run in runs if run.row["drive"] == rows[0]["drive"] and run.found is not None]
    return report_of(rows, list(summaries(rows, MEASURES, RATIOS)), _picture(drawn))


def _picture(runs: Sequence[Run]) -> Figure:
    figure = new_figure(11, 7.5)
    plan, errors, scales, weights = figure.subplots(2, 2).ravel()
    for run, color in zip(runs, COLORS, strict=False):
        found, style = run.found, {"color": color, "label": run.row["label"], "linewidth": 1.2}
        assert found is not None
        across, along = _axes_of_plan(found.truth.centres)
        plan.plot(found.estimate.centres @ across, found.estimate.centres @ along, **style)
        errors.plot(found.truth.t_s, found.ape["translation_part"], **style)
        scales.plot(*run.scales.T, **style)
        weights.plot(run.weights[:, 0], np.where(run.weights[:, 1] > 0, run.weights[:, 1], np.nan), **style)
    plan.plot(found.truth.centres @ across, found.truth.centres @ along, "k:", label="truth")
    plan.set_aspect("equal")
    weights.set_yscale("log")
    _finish(plan, "plan [m]", "")
    _finish(errors, "position error [m]", "seconds")
    _finish(scales, "step over the true one", "seconds")
    _finish(weights, "weight λ, zeros left out", "seconds")
    return figure


def _axes_of_plan(centres: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The two directions in which a path extends most."""
    _, _, directions = np.linalg.svd(centres - centres.mean(axis=0), full_matrices=False)
    return directions[0], directions[1]


def _finish(axes: Axes, title: str, below: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set_xlabel(below)
    style_axes(axes)
    axes.legend(frameon=False, fontsize=8)
