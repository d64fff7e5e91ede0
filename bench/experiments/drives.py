"""SLAM on real and synthetic drives, with and without sensors (thesis tables 5.5–5.7 and 5.9)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from experiments import summaries
from experiments.description import Experiment, Row
from experiments.faults import SensorFaults
from experiments.inputs import (
    Drive,
    Input,
    dead_reckoning,
    has_odometer,
    mounting_of,
    on_all_inputs,
    rotation_stream,
    sensor_of_drive,
    sequence_of,
)
from experiments.pictures import grouped_bars
from sfmcpp.model import Trajectory
from sfmcpp.model.arrays import FloatArray
from sfmcpp.slam import Odometer, SlamResult, SlamSettings, run_slam
from sfmcpp.study.evaluation.evaluate import Evaluation, evaluate
from sfmcpp.study.plotting.style import new_figure, style_axes
from sfmcpp.weighting import filter_trajectory

from experiments.report import Report  # isort: skip

NOTES = (
    "error: mean 3-D error (thesis eq. 5.24) of all frames, aligned by the poses of the first tenth, scale",
    "included [m]; over_alone: over that without sensors, over_reference: over that of the line so named.",
    "whole: the same aligned to all frames, rigidly where a sensor gives metres, else by a similarity.",
    "scale: mean ratio of keyframe steps to true ones (eq. 5.25); of a map without metres after alignment.",
    "rotation, end_rotation: median error after it, of all frames and of the last tenth [deg].",
    "weight: median λ of each sensor. world_error: with nothing aligned, where a GPS or an INS tells the",
    "world [m]. weight_fault, conflict_fault [standard deviations]: while the sensor is faulty.",
    "predicted: frames whose images say too little. failed: runs without a map.",
    *summaries.NOTES,
)
MEASURES = (
    "error_m", "over_alone", "over_reference", "whole_m", "whole_over_alone", "world_error_m", "scale",
    "rotation_deg", "end_rotation_deg", "weight", "weight_fault", "conflict_fault", "predicted",
)  # fmt: skip
RATIOS = ("over_alone", "over_reference", "whole_over_alone")
COLUMNS = (
    "drive", "label", "error_m", "over_alone", "[over_alone]", "over_reference", "[over_reference]",
    "whole_m", "whole_over_alone", "[whole_over_alone]", "world_error_m", "scale", "rotation_deg",
    "end_rotation_deg", "weight", "weight_fault", "conflict_fault", "predicted", "runs", "failed",
)  # fmt: skip
ALONE = "alone"
# Shorter steps tell no scale.
MIN_STEP_M = 0.05


@dataclass(frozen=True, eq=False)
class Run:
    """One line of a TOML file on one drive.

    Attributes
    ----------
    row : dict
        What was measured.
    found : Evaluation or None
        All frames beside the truth; None without a map.
    weights, scales : (k, 2) float64
        Time of each keyframe [s], and the weight of its constraint, or its step over the true one.
    """

    row: Row
    found: Evaluation | None
    weights: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))
    scales: FloatArray = field(default_factory=lambda: np.zeros((0, 2)))


def sensors_on_drives(experiment: Experiment) -> Report:
    """Run every setting on every drive."""
    rows = [run.row for run in runs_of(experiment)]
    return report_of(rows, list(summaries.summaries(rows, MEASURES, RATIOS)), _picture(rows))


def report_of(rows: list[Row], summed_up: list[Row], figure: Figure) -> Report:
    """Print the summaries, without empty columns; the file has all rows."""
    said = [name for name in COLUMNS if any(row.get(name) not in (None, []) for row in summed_up)]
    return Report(NOTES, ("drive", "label"), said, [*rows, *summed_up], figure, printed=summed_up)


def runs_of(experiment: Experiment) -> list[Run]:
    """Every line of the TOML file on every drive."""
    measure = partial(_runs_on, settings=experiment.settings)
    return [run for _, runs in on_all_inputs(experiment, measure) for run in runs]


def _runs_on(item: Input, settings: Row) -> list[Run]:
    drive = item.make()
    lines = [_line(line, settings, item.loop_seed) for line in settings["runs"] if _can(drive, line)]
    alone = run_setting(drive, lines[0])
    runs = [_run(drive, line, alone) for line in lines]
    rows = {run.row["label"]: run.row for run in runs}
    reference = rows.get(settings.get("reference"), {})
    for row in rows.values():
        row |= {"drive": item.name, "groups": list(item.groups), "seed": item.seed}
        row["over_alone"] = _ratio(row, rows[ALONE], "error_m")
        row["over_reference"] = _ratio(row, reference, "error_m")
        row["whole_over_alone"] = _ratio(row, rows[ALONE], "whole_m")
    return runs


def _can(drive: Drive, line: Row) -> bool:
    """Whether the drive has the sensors of a line: a walk has no odometer."""
    needs_odometer = "dead_reckoning" in line or "odometer" in line.get("sensors", [])
    return has_odometer(drive) or not needs_odometer


def _line(line: Row, settings: Row, seed: int) -> Row:
    """A line with the sensors and SLAM settings that hold for all lines; the first has no sensors."""
    sensors = [] if line["label"] == ALONE else settings.get("sensors", [])
    slam = {"seed": seed, **settings.get("slam", {}), **line.get("slam", {})}
    return {"sensors": sensors, **line, "slam": slam}


def _ratio(row: Row, other: Row, measure: str) -> float | None:
    ours, theirs = row.get(measure), other.get(measure)
    return None if ours is None or theirs is None else ours / theirs


def _run(drive: Drive, line: Row, alone: SlamResult) -> Run:
    if "dead_reckoning" in line:
        return _measured(line, drive, dead_reckoning(drive), metric=True)
    if "filter" in line:
        stream, mounting = rotation_stream(drive), mounting_of(drive)
        before = alone.keyframe_trajectory() if line.get("keyframes") else alone.trajectory()
        filtered = filter_trajectory(before, stream, mounting, **line["filter"])
        return _measured(line, drive, filtered, metric=False)
    faults = SensorFaults(**line["fault"]) if "fault" in line else None
    result = run_setting(drive, line, faults) if line["label"] != ALONE else alone
    if result.world is None:
        return Run({"label": line["label"], "error_m": None}, None)
    trajectory = result.keyframe_trajectory() if line.get("keyframes") else result.trajectory()
    run = _measured(line, drive, trajectory, metric=result.metric)
    assert run.found is not None
    metres = 1.0 if result.metric else run.found.alignment.similarity.scale
    scales = _scale_ratios(result, drive, metres)
    run.row.update(
        predicted=len(result.lost),
        keyframes=len(result.world.keyframes),
        world_error_m=_error_in_world(result, drive, line["sensors"]),
        scale=float(np.mean(scales[:, 1])),
        **_weights(result, drive, line["sensors"], faults),
    )
    weights = np.array([[r.t_s, w] for r in result.records for w in r.weights.values()]).reshape(-1, 2)
    return replace(run, weights=weights, scales=scales)


def _measured(line: Row, drive: Drive, trajectory: Trajectory, *, metric: bool) -> Run:
    found = against_truth(trajectory, drive)
    whole = evaluate(trajectory, drive.truth, with_scale=not metric)
    rotation_deg = found.ape["rotation_angle_deg"]
    row = {
        "label": line["label"],
        "error_m": found.mean_3d_error_m,
        "whole_m": whole.mean_3d_error_m,
        "rotation_deg": float(np.median(rotation_deg)),
        "end_rotation_deg": float(np.median(rotation_deg[-max(len(rotation_deg) // 10, 1) :])),
    }
    return Run(row, found)


def run_setting(drive: Drive, setting: Row, faults: SensorFaults | None = None) -> SlamResult:
    """Run SLAM with the sensors, weights and further settings of a line of a TOML file.

    An odometer declares the `share` of the distance, if there is one.
    """
    settings = SlamSettings(weights=setting.get("weights", "loo"), **setting.get("slam", {}))
    share = setting.get("share")
    declared = {} if share is None else {"relative_sigma": share}
    made = [sensor_of_drive(drive, name, faults) for name in setting["sensors"]]
    sensors = [replace(s, **declared) if isinstance(s, Odometer) else s for s in made]
    return run_slam(sequence_of(drive, setting.get("stereo", False)), settings, sensors)


def against_truth(trajectory: Trajectory, drive: Drive) -> Evaluation:
    """Measure all frames, aligned by the poses of the first tenth."""
    return evaluate(trajectory, drive.truth, align_to="first:0.1", align_by="poses")


def _error_in_world(result: SlamResult, drive: Drive, sensors: Sequence[str]) -> float | None:
    """Mean 3-D error with nothing aligned, where sensors tell the world; None elsewhere [m]."""
    if not result.metric or not {"gps", "ins"} & set(sensors):
        return None
    return evaluate(result.trajectory(), drive.truth, align_to="none").mean_3d_error_m


def _scale_ratios(result: SlamResult, drive: Drive, metres: float) -> FloatArray:
    """Time of each keyframe, and length of the step to it over the true one (eq. 5.25), where it moves."""
    assert result.world is not None
    frames = [keyframe.frame for keyframe in result.world.keyframes]
    steps = metres * np.linalg.norm(np.diff(result.world.poses[:, :, 3], axis=0), axis=1)
    true = np.linalg.norm(np.diff(drive.truth.poses[frames][:, :, 3], axis=0), axis=1)
    moves = true > MIN_STEP_M
    return np.column_stack([drive.t_s[frames][1:][moves], steps[moves] / true[moves]])


def _weights(result: SlamResult, drive: Drive, sensors: Sequence[str], faults: SensorFaults | None) -> Row:
    names = [{"imu": "gyro", "rotation": "gyro"}.get(name, name) for name in sensors]
    stamps = np.array([record.t_s for record in result.records])
    during = np.zeros(len(stamps), dtype=bool) if faults is None else faults.during(stamps, drive.t_s[0])
    sound = [r for r, wrong in zip(result.records, during, strict=True) if not wrong]
    faulty = [r for r, wrong in zip(result.records, during, strict=True) if wrong]
    return {
        "weight": [median([r.weights[n] for r in sound if n in r.weights]) for n in names],
        "weight_fault": [median([r.weights[n] for r in faulty if n in r.weights]) for n in names],
        "conflict_fault": [median([r.conflicts[n] for r in faulty if n in r.conflicts]) for n in names],
    }


def median(values: Sequence[float]) -> float | None:
    """Median of what there is; None of nothing."""
    return float(np.median(values)) if len(values) else None


def _picture(rows: list[Row]) -> Figure:
    drives = list(dict.fromkeys(row["drive"] for row in rows))
    labels = list(dict.fromkeys(row["label"] for row in rows))
    first = {(row["drive"], row["label"]): row["error_m"] for row in reversed(rows)}
    figure = new_figure(11, 4.5)
    axes = figure.subplots()
    grouped_bars(axes, {x: [first.get((drive, x)) or np.nan for drive in drives] for x in labels})
    axes.set_yscale("log")
    axes.set_ylabel("mean 3-D error [m]")
    short = [name.rpartition("_")[2].replace(" ", "\n") for name in drives]
    axes.set_xticks(range(len(drives)), short, fontsize=8)
    style_axes(axes)
    axes.legend(
        fontsize=8, frameon=False, ncols=len(labels) // 2 + 1, loc="lower center", bbox_to_anchor=(0.5, 1)
    )
    return figure
