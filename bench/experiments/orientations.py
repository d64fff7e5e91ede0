"""Orientations of a sensor: weights chosen, constant ones, and a filter after SLAM (thesis §5.4.3.1)."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.drives import ALONE, MEASURES, RATIOS, Run, report_of, runs_of
from experiments.report import Report
from experiments.summaries import summaries
from sfmcpp.study.evaluation.evaluate import Evaluation
from sfmcpp.study.plotting.style import COLORS, MUTED, new_figure, style_axes

CONSTANT, FILTER = "constant", "EKF"
_STYLES = ("-", "-", "--", ":", "-.")
_TIMES = 500


def methods_with_orientations(experiment: Experiment) -> Report:
    """Table 5.9 and figure 5.20: every method on every drive, and the errors of one group along time."""
    runs = runs_of(experiment)
    return _report(runs, _along_time(runs, experiment.settings["drawn"]))


def constant_weights_of_orientations(experiment: Experiment) -> Report:
    """Figure 5.21: the error over a constant weight, beside the methods that choose."""
    runs = runs_of(experiment)
    return _report(runs, _over_weights(runs))


def _report(runs: list[Run], figure: Figure) -> Report:
    rows = [run.row for run in runs]
    summed_up = list(summaries(rows, MEASURES, RATIOS))
    for name in dict.fromkeys(row["drive"] for row in summed_up):
        of_group = [row for row in summed_up if row["drive"] == name]
        summed_up += [_best(of_group, kind) for kind in (CONSTANT, FILTER) if _among(of_group, kind)]
    return report_of(rows, summed_up, figure)


def _among(rows: list[Row], kind: str) -> list[Row]:
    return [row for row in rows if row["label"].startswith(kind) and row["over_alone"] is not None]


def _best(rows: list[Row], kind: str) -> Row:
    """The one of a kind whose error is least, known afterwards."""
    best = min(_among(rows, kind), key=lambda row: float(row["over_alone"]))
    return {**best, "label": f"best {kind}", "which": best["label"]}


def _along_time(runs: list[Run], drawn: Row) -> Figure:
    """Figure 5.20: the position error of some labels, in the mean over the drives of a group."""
    figure = new_figure(9, 4.5)
    axes = figure.subplots()
    for label, color, style in zip(drawn["labels"], [MUTED, *COLORS], _STYLES, strict=False):
        of_label = [r for r in runs if drawn["group"] in r.row["groups"] and r.row["label"] == label]
        shown = [r.found for r in of_label if r.found is not None]
        seconds, error_m = _mean_error(shown)
        axes.plot(seconds, error_m, color=color, linestyle=style, linewidth=1.5, label=label)
    axes.set_title(f"{drawn['group']}, mean of {len(shown)}", fontsize=10)
    axes.set_xlabel("seconds")
    axes.set_ylabel("position error [m]")
    _finish(axes)
    return figure


def _mean_error(found: Sequence[Evaluation]) -> tuple[np.ndarray, np.ndarray]:
    """Seconds, and the mean of the position errors there, as long as every run lasts."""
    seconds = np.linspace(
        max(one.truth.t_s[0] for one in found), min(one.truth.t_s[-1] for one in found), _TIMES
    )
    errors = [np.interp(seconds, one.truth.t_s, one.ape["translation_part"]) for one in found]
    return seconds, np.mean(errors, axis=0)


def _over_weights(runs: list[Run]) -> Figure:
    """One panel for each group: every drive a thin line, the median a thick one, the methods level lines."""
    rows = [run.row for run in runs]
    medians = list(summaries(rows, MEASURES, RATIOS))
    groups = list(dict.fromkeys(group for row in rows for group in row["groups"]))
    figure = new_figure(5.5 * len(groups), 4.8)
    for axes, group in zip(np.atleast_1d(figure.subplots(1, len(groups))), groups, strict=True):
        of_group = [row for row in rows if group in row["groups"]]
        for k, drive in enumerate(dict.fromkeys((row["drive"], row["seed"]) for row in of_group)):
            constants = [row for row in of_group if (row["drive"], row["seed"]) == drive]
            _draw_constants(axes, constants, color="#bbbbbb", width=0.8, label="" if k else "each run")
        of_median = [row for row in medians if row["drive"] == f"{group}, median"]
        _draw_constants(axes, of_median, color=COLORS[0], width=2.0, label="constant weight, median")
        _draw_levels(axes, of_median)
        axes.set_title(group, fontsize=10)
        axes.set_xscale("log")
        axes.set_ylim(bottom=0)
        axes.set_xlabel("constant weight λ")
        axes.set_ylabel("mean 3-D error over that alone")
        _finish(axes)
    return figure


def _draw_constants(axes: Axes, rows: list[Row], *, color: str, width: float, label: str = "") -> None:
    points = sorted((float(row["label"].split()[1]), row["over_alone"]) for row in _among(rows, CONSTANT))
    axes.plot(*zip(*points, strict=True), color=color, linewidth=width, label=label or None)


def _draw_levels(axes: Axes, medians: list[Row]) -> None:
    levels = [row for row in medians if not row["label"].startswith((ALONE, CONSTANT))]
    for row, color, style in zip(levels, COLORS[1:], _STYLES[1:], strict=False):
        axes.axhline(row["over_alone"], color=color, linestyle=style, linewidth=1.5, label=row["label"])


def _finish(axes: Axes) -> None:
    style_axes(axes)
    axes.legend(frameon=False, fontsize=8)
