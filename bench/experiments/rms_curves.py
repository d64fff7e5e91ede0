"""Mean normalised RMS against iterations (thesis figures 4.5 and 4.6)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.measures import normalised_rms
from experiments.pictures import figure_legend, line_style
from experiments.report import Report
from experiments.runs import FloatArray, Run, camera_models, select, solve_in_turn
from experiments.starts import synthetic_starts
from sfmcpp.study.plotting.style import new_figure, style_axes

STEPS = 5
NOTES = (
    "rms_k: mean of RMS after k steps over the initial RMS; a run that has ended keeps its last value.",
    "gain: mean over steps 1–4 of rms_k(LM) − rms_k, in percent of the initial RMS.",
    "rms_1_over_LM: mean RMS after the first step over that of LM.",
)
COLUMNS = (
    "camera_model",
    "label",
    "runs",
    *(f"rms_{k}" for k in range(1, STEPS + 1)),
    "gain",
    "rms_1_over_LM",
)

Curves = dict[tuple[str, str], FloatArray]


def mean_rms(experiment: Experiment) -> Report:
    """Run every method from every start for a few steps and average the RMS."""
    runs = solve_in_turn(synthetic_starts(experiment), experiment.solve_options())
    curves = _mean_curves(runs, experiment.methods)
    rows = [_row(key, curves, experiment) for key in curves]
    return Report(NOTES, ("label", "camera_model"), COLUMNS, rows, _picture(curves))


def _mean_curves(runs: list[Run], labels: list[str]) -> Curves:
    return {
        (model, label): np.mean([normalised_rms(run, STEPS) for run in select(runs, label, model)], axis=0)
        for model in camera_models(runs)
        for label in labels
    }


def _row(key: tuple[str, str], curves: Curves, experiment: Experiment) -> Row:
    model, label = key
    options = experiment.solve_options()[label]
    curve, reference = curves[key], curves[model, experiment.methods[0]]
    return {
        "label": label,
        "method": options["method"],
        "line_search": options.get("line_search", "none"),
        "camera_model": model,
        "runs": experiment.runs,
        **{f"rms_{k}": float(curve[k]) for k in range(STEPS + 1)},
        "gain": 100 * float(np.mean((reference - curve)[1:5])),
        "rms_1_over_LM": float(curve[1] / reference[1]),
    }


def _picture(curves: Curves) -> Figure:
    models = list(dict.fromkeys(model for model, _ in curves))
    figure = new_figure(5.2 * len(models), 5.2)
    panels = figure.subplots(1, len(models), squeeze=False)[0]
    for axes, model in zip(panels, models, strict=True):
        _draw(axes, {label: curve for (of, label), curve in curves.items() if of == model})
        axes.set_title(model, fontsize=10)
    panels[0].set_ylabel("mean RMS over the initial one")
    figure_legend(panels[0], 5)
    return figure


def _draw(axes: Axes, curves: dict[str, FloatArray]) -> None:
    # Curves that coincide stay visible, the later ones thinner.
    widths = np.linspace(3.0, 0.8, len(curves))
    for (label, curve), width in zip(curves.items(), widths, strict=True):
        axes.plot(curve, markersize=4, linewidth=width, **line_style(label))
    style_axes(axes)
    axes.set_yscale("log")
    axes.set_xlabel("iteration")
