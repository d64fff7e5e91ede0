"""The weight each criterion would choose at every keyframe, none of them used (thesis §5.2.3.2)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.inputs import drive_files, sensor_of_drive, sequence_of
from experiments.report import Report
from sfmcpp.slam import Frame, Slam, SlamResult, SlamSettings, WorldMap
from sfmcpp.slam.fusing import fuse
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.sources.io.kitti_mat import KittiDrive, read_kitti_mat
from sfmcpp.study.plotting.style import new_figure, style_axes
from sfmcpp.weighting import WeightSelection

NOTES = (
    "Visual SLAM alone; at each keyframe the weight of the sensor's constraint is chosen, and not used.",
    "zero: share of keyframes at which a method chooses no weight at all; the others count in the median.",
)
COLUMNS = ("sensor", "method", "keyframes", "zero", "median", "mean", "std")
Selections = dict[str, list[WeightSelection]]


def weights_at_keyframes(experiment: Experiment) -> Report:
    """Table 5.2 and figure 5.8: statistics of the weights, and their course over one drive."""
    settings = experiment.settings
    drives = [read_kitti_mat(file) for file in drive_files(experiment)]
    rows: list[Row] = []
    first: Selections = {}
    for name in settings["sensors"]:
        found = [selections(drive, name, settings["methods"]) for drive in drives]
        first = first or found[0]
        rows += [_row(name, method, [s for drive in found for s in drive[method]]) for method in first]
    return Report(NOTES, ("sensor", "method"), COLUMNS, rows, _course(first))


def criteria_over_weights(experiment: Experiment) -> Report:
    """Figures 5.4 to 5.7: both errors and each criterion over λ, at one keyframe."""
    settings = experiment.settings
    drive = read_kitti_mat(drive_files(experiment)[0])
    found = selections(drive, settings["sensors"][0], settings["methods"])
    at = {method: chosen[settings["keyframe"]] for method, chosen in found.items()}
    rows = [
        {"sensor": settings["sensors"][0], "method": method, "keyframes": 1, "median": chosen.weight}
        for method, chosen in at.items()
    ]
    return Report(NOTES[:1], ("sensor", "method"), ("sensor", "method", "median"), rows, _curves(at))


def selections(drive: KittiDrive, sensor: str, methods: list[str]) -> Selections:
    """What each method chooses at each keyframe of a run that uses none of it."""
    suite = SensorSuite([sensor_of_drive(drive, sensor, None)])
    sequence = sequence_of(drive)
    slam = Slam(sequence.intrinsics, SlamSettings(weights="none"), suite.sensors)
    found: Selections = {method: [] for method in methods}
    known = np.zeros(0, dtype=bool)
    for frame in sequence:
        records = len(slam.result.records)
        slam.step(frame)
        if len(slam.result.records) > records and len(known):
            _choose(slam.result, known, suite, found)
        if slam.result.world is not None:
            known = slam.result.world.known
    return found


def _choose(result: SlamResult, known: np.ndarray, suite: SensorSuite, found: Selections) -> None:
    """Choose for the newest keyframe by the points known before it (eq. 5.15)."""
    assert result.world is not None
    *earlier, newest = result.world.keyframes
    world = WorldMap(result.world.intrinsics[0])
    for keyframe in earlier:
        frame = Frame(keyframe.frame, keyframe.t_s, keyframe.view)
        world.add(frame, keyframe.pose, keyframe.constraints)
    before = np.flatnonzero(known)
    world.points[before] = result.world.points[before]
    rotation = newest.pose[:, :3]
    measured = suite.measure(earlier[-1].t_s, newest.t_s, rotation, metric=result.metric)
    for method, chosen in found.items():
        settings = replace(SlamSettings(), weights=method, weight_bounds="none")
        chosen += fuse(world, newest.view, newest.pose, measured, settings).selections


def _row(sensor: str, method: str, chosen: list[WeightSelection]) -> Row:
    weights = np.array([selection.weight for selection in chosen])
    used = weights[weights > 0]
    return {
        "sensor": sensor,
        "method": method,
        "keyframes": len(weights),
        "zero": float(np.mean(weights == 0)) if len(weights) else None,
        "median": float(np.median(used)) if len(used) else None,
        "mean": float(used.mean()) if len(used) else None,
        "std": float(used.std()) if len(used) else None,
    }


def _course(found: Selections) -> Figure:
    figure = new_figure(10, 4)
    axes = figure.subplots()
    for method, chosen in found.items():
        weights = np.array([selection.weight for selection in chosen])
        axes.plot(np.where(weights > 0, weights, np.nan), marker="o", markersize=3, linewidth=1, label=method)
    axes.set_yscale("log")
    axes.set_xlabel("keyframe")
    axes.set_ylabel("weight λ, zeros left out")
    style_axes(axes)
    axes.legend(frameon=False, fontsize=8, ncols=len(found))
    return figure


def _curves(at: dict[str, WeightSelection]) -> Figure:
    figure = new_figure(11, 3.2 * 2)
    panels = figure.subplots(2, -(-(len(at) + 1) // 2)).ravel()
    _draw_errors(panels[0], next(iter(at.values())))
    for axes, (method, chosen) in zip(panels[1:], at.items(), strict=False):
        positive = chosen.weights > 0
        axes.plot(chosen.weights[positive], np.asarray(chosen.score)[positive], label="score")
        if chosen.weight > 0:
            axes.axvline(chosen.weight, color="#D55E00", linestyle="--", label=f"λ = {chosen.weight:.3g}")
        axes.set_title(method, fontsize=10)
        _finish(axes)
    for axes in panels[len(at) + 1 :]:
        axes.set_axis_off()
    return figure


def _draw_errors(axes: Axes, chosen: WeightSelection) -> None:
    positive = chosen.weights > 0
    for values, label in ((chosen.vision, "pixels [px²]"), (chosen.constraint_error, "constraint")):
        axes.plot(chosen.weights[positive], values[positive], label=label)
    axes.set_yscale("log")
    axes.set_title("mean squared errors", fontsize=10)
    _finish(axes)


def _finish(axes: Axes) -> None:
    axes.set_xscale("log")
    axes.set_xlabel("weight λ")
    style_axes(axes)
    axes.legend(frameon=False, fontsize=8)
