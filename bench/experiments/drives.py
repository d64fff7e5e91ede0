"""SLAM on real drives, with and without sensors (thesis tables 5.5–5.7)."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.real_problems import data_folder
from sfmcpp.evaluation.evaluate import Evaluation, evaluate
from sfmcpp.io.kitti_mat import KittiDrive, read_kitti_mat
from sfmcpp.model import SensorStream
from sfmcpp.plotting.style import new_figure, style_axes
from sfmcpp.sensors import Mounting
from sfmcpp.slam import Gyroscope, MotionSensor, Odometer, SlamResult, SlamSettings, TrackSequence, run_slam

from experiments.report import Report  # isort: skip

NOTES = (
    "error: mean 3-D error (thesis eq. 5.24) of all frames, aligned by the poses of the first tenth, scale",
    "included [m]; over_alone: over that without sensors. scale: mean ratio of keyframe steps to true ones",
    "(eq. 5.25), of maps that have metres. rotation: median error after the alignment [deg].",
    "weight: median λ of each sensor; weight_lie, conflict_lie [standard deviations]: while the sensor lies.",
    "predicted: frames whose images say too little. The gyro of these drives is 0.05 s late: shifted.",
)
COLUMNS = (
    "drive", "label", "frames", "predicted", "keyframes", "error_m", "over_alone", "scale", "rotation_deg",
    "weight", "weight_lie", "conflict_lie", "fps",
)  # fmt: skip
GYRO_LAG_S = 0.05
MIN_STEP_M = 0.05


@dataclass(frozen=True, eq=False)
class Lie:
    """What is wrong with a sensor for a while: speeds times `factor`, yaw rates plus `bias_deg_s`."""

    start_s: float
    seconds: float
    factor: float = 1.0
    bias_deg_s: float = 0.0

    def during(self, t_s: np.ndarray, first_s: float) -> np.ndarray:
        """Which of the stamps it covers."""
        return np.asarray((t_s - first_s >= self.start_s) & (t_s - first_s < self.start_s + self.seconds))


def sensors_on_drives(experiment: Experiment) -> Report:
    """Run every setting on every drive."""
    rows: list[Row] = []
    for file in experiment.files:
        drive = read_kitti_mat(data_folder() / file)
        name = file.rpartition("/")[2][5:].partition("_sync")[0]
        rows += _rows_of(name, drive, experiment.settings["runs"])
    rows += [_median_row(rows, setting["label"]) for setting in experiment.settings["runs"]]
    return Report(NOTES, ("drive", "label"), COLUMNS, rows, _picture(rows))


def _rows_of(name: str, drive: KittiDrive, settings: Sequence[Row]) -> list[Row]:
    rows = [_row(drive, setting) for setting in settings]
    alone = rows[0]["error_m"]
    return [{"drive": name, **row, "over_alone": row["error_m"] / alone} for row in rows]


def _row(drive: KittiDrive, setting: Row) -> Row:
    lie = Lie(**setting["lie"]) if "lie" in setting else None
    sensors = [sensor_of_drive(drive, name, lie) for name in setting["sensors"]]
    started = time.perf_counter()
    result = run_slam(
        sequence_of(drive),
        SlamSettings(weights=setting.get("weights", "loo"), **setting.get("slam", {})),
        sensors,
    )
    seconds = time.perf_counter() - started
    found = evaluate(result.trajectory(drive.t_s), drive.truth, align_to="first:0.1", align_by="poses")
    return {
        "label": setting["label"],
        "frames": len(drive.t_s),
        "predicted": len(result.lost),
        "keyframes": 0 if result.world is None else len(result.world.keyframes),
        "error_m": found.mean_3d_error_m,
        "scale": _scale(result, drive) if result.metric else None,
        "rotation_deg": _rotation_deg(found),
        **_weights(result, drive, setting["sensors"], lie),
        "fps": len(drive.t_s) / seconds,
    }


def sequence_of(drive: KittiDrive) -> TrackSequence:
    """Tracks of the left camera."""
    return TrackSequence(drive.t_s, drive.frame_index, drive.track_index, drive.left_px, drive.intrinsics)


def sensor_of_drive(drive: KittiDrive, name: str, lie: Lie | None) -> MotionSensor:
    """Make ``"odometer"`` or ``"imu"`` from the streams of a drive."""
    if name == "odometer":
        return Odometer(_lying(drive.velocity, lie, factor=True))
    mounting = Mounting(drive.camera_from_body, drive.lever_arm_m)
    return Gyroscope(_lying(drive.angular_rate, lie, factor=False).shifted(-GYRO_LAG_S), mounting)


def _lying(stream: SensorStream, lie: Lie | None, *, factor: bool) -> SensorStream:
    if lie is None:
        return stream
    values = stream.values.copy()
    during = lie.during(stream.t_s, stream.t_s[0])
    if factor:
        values[during] *= lie.factor
    else:
        values[during, 2] += np.radians(lie.bias_deg_s)
    return SensorStream(stream.t_s, values, stream.kind, stream.name)


def _scale(result: SlamResult, drive: KittiDrive) -> float:
    assert result.world is not None
    frames = [keyframe.frame for keyframe in result.world.keyframes]
    steps = np.linalg.norm(np.diff(result.world.poses()[:, :, 3], axis=0), axis=1)
    true = np.linalg.norm(np.diff(drive.truth.poses[frames][:, :, 3], axis=0), axis=1)
    return float(np.mean(steps[true > MIN_STEP_M] / true[true > MIN_STEP_M]))


def _rotation_deg(found: Evaluation) -> float:
    return float(np.median(found.ape["rotation_angle_deg"]))


def _weights(result: SlamResult, drive: KittiDrive, sensors: Sequence[str], lie: Lie | None) -> Row:
    names = ["gyro" if name == "imu" else name for name in sensors]
    stamps = np.array([record.t_s for record in result.records])
    during = np.zeros(len(stamps), dtype=bool) if lie is None else lie.during(stamps, drive.t_s[0])
    honest = [r for r, lies in zip(result.records, during, strict=True) if not lies]
    lying = [r for r, lies in zip(result.records, during, strict=True) if lies]
    return {
        "weight": [_median([r.weights[n] for r in honest if n in r.weights]) for n in names],
        "weight_lie": [_median([r.weights[n] for r in lying if n in r.weights]) for n in names],
        "conflict_lie": [_median([r.conflicts[n] for r in lying if n in r.conflicts]) for n in names],
    }


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None


def _median_row(rows: list[Row], label: str) -> Row:
    same = [row for row in rows if row["label"] == label]
    columns = ("error_m", "over_alone", "scale", "rotation_deg", "fps")
    medians = {name: _median([row[name] for row in same if row[name] is not None]) for name in columns}
    return {"drive": "median", "label": label, "predicted": sum(row["predicted"] for row in same), **medians}


def _picture(rows: list[Row]) -> Figure:
    drives = list(dict.fromkeys(row["drive"] for row in rows if row["drive"] != "median"))
    labels = list(dict.fromkeys(row["label"] for row in rows))
    figure = new_figure(11, 4.5)
    axes = figure.subplots()
    width = 0.8 / len(labels)
    for k, label in enumerate(labels):
        errors = [row["error_m"] for row in rows if row["label"] == label and row["drive"] != "median"]
        axes.bar(np.arange(len(drives)) + (k - len(labels) / 2 + 0.5) * width, errors, width, label=label)
    axes.set_yscale("log")
    axes.set_ylabel("mean 3-D error [m]")
    axes.set_xticks(range(len(drives)), drives, fontsize=8)
    style_axes(axes)
    axes.legend(fontsize=8, frameon=False, ncols=3)
    return figure
