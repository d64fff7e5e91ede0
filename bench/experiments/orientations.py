"""Orientations of a sensor: weights chosen, constant ones, and a filter after SLAM (thesis §5.4.3.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.drives import against_truth, median, median_name, rotation_deg, run_setting
from experiments.inputs import Drive, Input, inputs_of, mounting_of, rotation_stream
from experiments.report import Report
from sfmcpp.slam import SlamResult
from sfmcpp.study.evaluation.evaluate import Evaluation, evaluate
from sfmcpp.study.plotting.style import COLORS, MUTED, new_figure, style_axes
from sfmcpp.weighting import filter_trajectory

NOTES = (
    "Rotations from keyframe to keyframe constrain SLAM: of the gyro on KITTI, of the",
    "navigation system (σ = 0.01°) on the synthetic walks. EKF: the run alone, its orientations filtered,",
    "positions recomputed; σ of the orientations that correct [rad]. error: mean 3-D error (eq. 5.24),",
    "aligned by the poses of the first tenth, scale included [m]; over_alone: over that without sensor.",
    "rotation: median error after the alignment [deg]. weight: median λ.",
    "best constant, best EKF: the one whose over_alone is least in the median of its group, afterwards.",
)
COLUMNS = ("drive", "label", "error_m", "over_alone", "rotation_deg", "weight")
ALONE, CONSTANT, FILTER = "alone", "constant", "EKF"
_STYLES = ("-", "-", "--", ":", "-.")
_TIMES = 500
MEASURES = ("error_m", "over_alone", "rotation_deg", "weight")


@dataclass(frozen=True, eq=False)
class _Run:
    """One line of the TOML file on one drive."""

    item: Input
    row: Row
    found: Evaluation


def methods_with_orientations(experiment: Experiment) -> Report:
    """Table 5.9 and figure 5.20: every method on every drive, and the errors of one drive along time."""
    runs = _all_runs(experiment)
    rows = [run.row for run in runs]
    figure = _along_time(runs, experiment.settings["drawn"])
    medians = _medians(rows)
    return Report(NOTES, ("drive", "label"), COLUMNS, [*rows, *medians], figure, printed=medians)


def constant_weights_of_orientations(experiment: Experiment) -> Report:
    """Figure 5.21: the error over a constant weight, beside the methods that choose."""
    rows = [run.row for run in _all_runs(experiment)]
    medians = _medians(rows)
    figure = _over_weights(rows, medians)
    return Report(NOTES, ("drive", "label"), COLUMNS, [*rows, *medians], figure, printed=medians)


def _all_runs(experiment: Experiment) -> list[_Run]:
    return [run for item in inputs_of(experiment) for run in _runs_of(item, experiment.settings["runs"])]


def _runs_of(item: Input, settings: Sequence[Row]) -> list[_Run]:
    alone = run_setting(item.drive, {"sensors": []})
    error_alone_m = against_truth(alone, item.drive).mean_3d_error_m
    return [_run(item, setting, alone, error_alone_m) for setting in settings]


def _run(item: Input, setting: Row, alone: SlamResult, error_alone_m: float) -> _Run:
    found, weight = _measured(item.drive, setting, alone)
    error_m = found.mean_3d_error_m
    row = {
        "drive": item.name,
        "group": item.group,
        "label": setting["label"],
        "error_m": error_m,
        "over_alone": error_m / error_alone_m,
        "rotation_deg": rotation_deg(found),
        "weight": weight,
    }
    return _Run(item, row, found)


def _measured(drive: Drive, setting: Row, alone: SlamResult) -> tuple[Evaluation, float | None]:
    """The evaluation of a line, and the median of its weights."""
    if "filter" in setting:
        stream, mounting = rotation_stream(drive), mounting_of(drive)
        filtered = filter_trajectory(alone.trajectory(), stream, mounting, **setting["filter"])
        return evaluate(filtered, drive.truth, align_to="first:0.1", align_by="poses"), None
    if "weights" not in setting:
        return against_truth(alone, drive), None
    result = run_setting(drive, {"sensors": ["rotation"], **setting})
    return against_truth(result, drive), median([w for r in result.records for w in r.weights.values()])


def _medians(rows: list[Row]) -> list[Row]:
    """Medians of each group, and those of its best constant weight and its best filter."""
    found = []
    for group in dict.fromkeys(row["group"] for row in rows):
        labels = dict.fromkeys(row["label"] for row in rows if row["group"] == group)
        medians = [_median(rows, group, label) for label in labels]
        found += medians + [_best(medians, kind) for kind in (CONSTANT, FILTER)]
    return found


def _median(rows: list[Row], group: str, label: str) -> Row:
    same = [row for row in rows if (row["group"], row["label"]) == (group, label)]
    measures = {name: median([row[name] for row in same if row[name] is not None]) for name in MEASURES}
    return {"drive": median_name(group), "label": label, **measures}


def _best(medians: list[Row], kind: str) -> Row:
    among = [row for row in medians if row["label"].startswith(kind)]
    best = min(among, key=lambda row: float(row["over_alone"]))
    return {**best, "label": f"best {kind}", "which": best["label"]}


def _along_time(runs: list[_Run], drawn: Row) -> Figure:
    """Figure 5.20: the position error of some labels, in the mean over the drives of a group."""
    figure = new_figure(9, 4.5)
    axes = figure.subplots()
    for label, color, style in zip(drawn["labels"], [MUTED, *COLORS], _STYLES, strict=False):
        shown = [r.found for r in runs if (r.item.group, r.row["label"]) == (drawn["group"], label)]
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


def _over_weights(rows: list[Row], medians: list[Row]) -> Figure:
    """One panel for each group: every drive a thin line, the median a thick one, the methods level lines."""
    groups = list(dict.fromkeys(row["group"] for row in rows))
    figure = new_figure(5.5 * len(groups), 4.8)
    for axes, group in zip(np.atleast_1d(figure.subplots(1, len(groups))), groups, strict=True):
        of_group = [row for row in rows if row["group"] == group]
        for k, drive in enumerate(dict.fromkeys(row["drive"] for row in of_group)):
            constants = [row for row in of_group if row["drive"] == drive]
            _draw_constants(axes, constants, color="#bbbbbb", width=0.8, label="" if k else "each drive")
        of_median = [row for row in medians if row["drive"] == median_name(group)]
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
    points = sorted((row["weight"], row["over_alone"]) for row in rows if row["label"].startswith(CONSTANT))
    axes.plot(*zip(*points, strict=True), color=color, linewidth=width, label=label or None)


def _draw_levels(axes: Axes, medians: list[Row]) -> None:
    levels = [row for row in medians if not row["label"].startswith((ALONE, CONSTANT, "best"))]
    for row, color, style in zip(levels, COLORS[1:], _STYLES[1:], strict=False):
        axes.axhline(row["over_alone"], color=color, linestyle=style, linewidth=1.5, label=row["label"])


def _finish(axes: Axes) -> None:
    style_axes(axes)
    axes.legend(frameon=False, fontsize=8)
