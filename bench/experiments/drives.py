"""SLAM on real and synthetic drives, with and without sensors (thesis tables 5.5–5.7)."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.inputs import KITTI, Drive, Input, Lie, inputs_of, sensor_of_drive, sequence_of
from experiments.pictures import grouped_bars
from sfmcpp.slam import SlamResult, SlamSettings, run_slam
from sfmcpp.study.evaluation.evaluate import Evaluation, evaluate
from sfmcpp.study.plotting.style import new_figure, style_axes

from experiments.report import Report  # isort: skip

NOTES = (
    "error: mean 3-D error (thesis eq. 5.24) of all frames, aligned by the poses of the first tenth, scale",
    "included [m]; over_alone: over that without sensors. scale: mean ratio of keyframe steps to true ones",
    "(eq. 5.25), of a map without metres after the alignment. rotation: median error after it [deg].",
    "weight: median λ of each sensor; weight_lie, conflict_lie [standard deviations]: while the sensor lies.",
    "world_error: the same with nothing aligned, where a GPS or an INS tells the world [m].",
    "predicted: frames whose images say too little.",
)
COLUMNS = (
    "drive", "label", "frames", "predicted", "keyframes", "error_m", "over_alone", "world_error_m", "scale",
    "rotation_deg", "weight", "weight_lie", "conflict_lie", "fps",
)  # fmt: skip
MIN_STEP_M = 0.05


def sensors_on_drives(experiment: Experiment) -> Report:
    """Run every setting on every drive."""
    settings = experiment.settings["runs"]
    rows = [row for item in inputs_of(experiment) for row in _rows_of(item, settings)]
    groups = list(dict.fromkeys(row["group"] for row in rows))
    rows += [_median_row(rows, group, setting["label"]) for group in groups for setting in settings]
    return Report(NOTES, ("drive", "label"), COLUMNS, rows, _picture(rows))


def _rows_of(item: Input, settings: Sequence[Row]) -> list[Row]:
    rows = [_row(item.drive, setting) for setting in settings]
    alone = rows[0]["error_m"]
    named = {"drive": item.name, "group": item.group}
    return [{**named, **row, "over_alone": row["error_m"] / alone} for row in rows]


def _row(drive: Drive, setting: Row) -> Row:
    lie = Lie(**setting["lie"]) if "lie" in setting else None
    started = time.perf_counter()
    result = run_setting(drive, setting, lie)
    seconds = time.perf_counter() - started
    found = against_truth(result, drive)
    return {
        "label": setting["label"],
        "frames": len(drive.t_s),
        "predicted": len(result.lost),
        "keyframes": 0 if result.world is None else len(result.world.keyframes),
        "error_m": found.mean_3d_error_m,
        "world_error_m": _error_in_world(result, drive, setting["sensors"]),
        "scale": _scale(result, drive, 1.0 if result.metric else found.alignment.similarity.scale),
        "rotation_deg": rotation_deg(found),
        **_weights(result, drive, setting["sensors"], lie),
        "fps": len(drive.t_s) / seconds,
    }


def run_setting(drive: Drive, setting: Row, lie: Lie | None = None) -> SlamResult:
    """Run SLAM with the sensors, weights and further settings of a line of a TOML file."""
    settings = SlamSettings(weights=setting.get("weights", "loo"), **setting.get("slam", {}))
    sensors = [sensor_of_drive(drive, name, lie) for name in setting["sensors"]]
    return run_slam(sequence_of(drive, setting.get("stereo", False)), settings, sensors)


def against_truth(result: SlamResult, drive: Drive) -> Evaluation:
    """Measure all frames, aligned by the poses of the first tenth."""
    return evaluate(result.trajectory(), drive.truth, align_to="first:0.1", align_by="poses")


def _error_in_world(result: SlamResult, drive: Drive, sensors: Sequence[str]) -> float | None:
    """Mean 3-D error with nothing aligned, where sensors tell the world; None elsewhere [m]."""
    if not result.metric or not {"gps", "ins"} & set(sensors):
        return None
    return evaluate(result.trajectory(), drive.truth, align_to="none").mean_3d_error_m


def rotation_deg(found: Evaluation) -> float:
    """Median error of the rotations [deg]."""
    return float(np.median(found.ape["rotation_angle_deg"]))


def _scale(result: SlamResult, drive: Drive, metres: float) -> float:
    assert result.world is not None
    frames = [keyframe.frame for keyframe in result.world.keyframes]
    steps = metres * np.linalg.norm(np.diff(result.world.poses[:, :, 3], axis=0), axis=1)
    true = np.linalg.norm(np.diff(drive.truth.poses[frames][:, :, 3], axis=0), axis=1)
    return float(np.mean(steps[true > MIN_STEP_M] / true[true > MIN_STEP_M]))


def _weights(result: SlamResult, drive: Drive, sensors: Sequence[str], lie: Lie | None) -> Row:
    names = [{"imu": "gyro", "rotation": "gyro"}.get(name, name) for name in sensors]
    stamps = np.array([record.t_s for record in result.records])
    during = np.zeros(len(stamps), dtype=bool) if lie is None else lie.during(stamps, drive.t_s[0])
    honest = [r for r, lies in zip(result.records, during, strict=True) if not lies]
    lying = [r for r, lies in zip(result.records, during, strict=True) if lies]
    return {
        "weight": [median([r.weights[n] for r in honest if n in r.weights]) for n in names],
        "weight_lie": [median([r.weights[n] for r in lying if n in r.weights]) for n in names],
        "conflict_lie": [median([r.conflicts[n] for r in lying if n in r.conflicts]) for n in names],
    }


def median(values: Sequence[float]) -> float | None:
    """Median of what there is; None of nothing."""
    return float(np.median(values)) if len(values) else None


def _median_row(rows: list[Row], group: str, label: str) -> Row:
    same = [row for row in rows if (row["group"], row["label"]) == (group, label)]
    columns = ("error_m", "over_alone", "world_error_m", "scale", "rotation_deg", "fps")
    medians = {name: median([row[name] for row in same if row[name] is not None]) for name in columns}
    predicted = sum(row["predicted"] for row in same)
    return {"drive": median_name(group), "label": label, "predicted": predicted, **medians}


def median_name(group: str) -> str:
    """What the medians of a group are called."""
    return "median" if group == KITTI else f"{group}, median"


def _picture(rows: list[Row]) -> Figure:
    single = [row for row in rows if "group" in row]
    drives = list(dict.fromkeys(row["drive"] for row in single))
    labels = list(dict.fromkeys(row["label"] for row in single))
    figure = new_figure(11, 4.5)
    axes = figure.subplots()
    grouped_bars(axes, {x: [row["error_m"] for row in single if row["label"] == x] for x in labels})
    axes.set_yscale("log")
    axes.set_ylabel("mean 3-D error [m]")
    short = [name.rpartition("_")[2].replace(" ", "\n") for name in drives]
    axes.set_xticks(range(len(drives)), short, fontsize=8)
    style_axes(axes)
    axes.legend(
        fontsize=8, frameon=False, ncols=len(labels) // 2 + 1, loc="lower center", bbox_to_anchor=(0.5, 1)
    )
    return figure
