"""The weight each criterion would choose at every keyframe, none of them used (thesis §5.2.3.2)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.inputs import Drive, Input, on_all_inputs, sensor_of_drive, sequence_of
from experiments.report import Report
from sfmcpp.model.arrays import FloatArray
from sfmcpp.slam import Frame, Slam, SlamResult, SlamSettings, WorldMap
from sfmcpp.slam.fusion import pose_constraint, pose_view
from sfmcpp.slam.sensor_suite import SensorSuite
from sfmcpp.study.plotting.style import new_figure, style_axes
from sfmcpp.weighting import PoseConstraint, PoseView, WeightSelection, select_weight

NOTES = (
    "Visual SLAM alone; at each keyframe the weight of the sensor's constraint is chosen, and not used.",
    "zero: share of keyframes at which a method chooses no weight at all; the others count in the median.",
)
COLUMNS = ("drives", "sensor", "method", "keyframes", "zero", "median", "mean", "std")
Selections = dict[str, list[WeightSelection]]


@dataclass(frozen=True, eq=False)
class KeyframePose:
    """Where a weight can be chosen: what a camera sees, what a sensor says of it, its pose by the images."""

    view: PoseView
    constraint: PoseConstraint
    pose: FloatArray


def weights_at_keyframes(experiment: Experiment) -> Report:
    """Table 5.2 and figure 5.8: statistics of the weights, and their course over one drive."""
    settings = experiment.settings
    rows: list[Row] = []
    first: Selections = {}
    for (group, name), found in poses_of(experiment).items():
        chosen = _selections(found, settings["methods"])
        first = first or _selections(found[: settings["drawn"]], settings["methods"])
        rows += [_row(group, name, method, chosen[method]) for method in chosen]
    return Report(NOTES, ("sensor", "method"), COLUMNS, rows, _course(first))


def criteria_over_weights(experiment: Experiment) -> Report:
    """Figures 5.4 to 5.7: both errors and each criterion over λ, at one keyframe."""
    settings = experiment.settings
    (((_, sensor), poses),) = poses_of(experiment).items()
    at = _selections([poses[settings["keyframe"]]], settings["methods"])
    rows = [
        {"sensor": sensor, "method": method, "keyframes": 1, "median": chosen.weight}
        for method, (chosen,) in at.items()
    ]
    figure = _curves({method: chosen for method, (chosen,) in at.items()})
    return Report(NOTES[:1], ("sensor", "method"), ("sensor", "method", "median"), rows, figure)


def poses_of(experiment: Experiment) -> dict[tuple[str, str], list[KeyframePose]]:
    """All keyframes by group of drives and sensor, of those of ``settings.sensors`` that a drive has."""
    found: dict[tuple[str, str], list[KeyframePose]] = {}
    for item, of_sensors in on_all_inputs(experiment, partial(_poses_on, experiment)):
        for name, poses in of_sensors.items():
            found.setdefault((item.groups[-1], name), []).extend(poses)
    return found


def _poses_on(experiment: Experiment, item: Input) -> dict[str, list[KeyframePose]]:
    drive = item.make()
    sensors = [name for name in experiment.settings["sensors"] if name != "odometer" or _rolls(drive)]
    poses = {name: list(_keyframe_poses(drive, name)) for name in sensors}
    return {name: found for name, found in poses.items() if found}


def _rolls(drive: Drive) -> bool:
    return getattr(drive, "odometer", drive) is not None


def _keyframe_poses(drive: Drive, sensor: str) -> Iterator[KeyframePose]:
    """Poses of the keyframes of a run that uses no weight."""
    suite, sequence = SensorSuite([sensor_of_drive(drive, sensor)]), sequence_of(drive)
    slam = Slam(sequence.intrinsics, SlamSettings(weights="none"), suite.sensors)
    known = np.zeros(0, dtype=bool)
    for frame in sequence:
        records = len(slam.result.records)
        slam.step(frame)
        if len(slam.result.records) > records and len(known):
            yield from _newest(slam.result, known, suite)
        if slam.result.world is not None:
            known = slam.result.world.known


def _newest(result: SlamResult, known: np.ndarray, suite: SensorSuite) -> Iterator[KeyframePose]:
    """The newest keyframe, on the points known before it (eq. 5.15), and what the sensor says of it."""
    assert result.world is not None
    *earlier, newest = result.world.keyframes
    world = WorldMap(result.world.intrinsics[0])
    for keyframe in earlier:
        frame = Frame(keyframe.frame, keyframe.t_s, keyframe.view)
        world.add(frame, keyframe.pose, keyframe.constraints)
    before = np.flatnonzero(known)
    world.points[before] = result.world.points[before]
    view = pose_view(world, newest.view, newest.pose, SlamSettings())
    measured = suite.measure(earlier[-1].t_s, newest.t_s, newest.pose[:, :3], metric=result.metric)
    if view is not None:
        constraints = [pose_constraint(m, earlier[-1].pose) for m in measured]
        yield from (KeyframePose(view, constraint, newest.pose) for constraint in constraints)


def _selections(poses: list[KeyframePose], methods: list[str]) -> Selections:
    return {m: [select_weight(p.view, p.constraint, p.pose, m, threads=0) for p in poses] for m in methods}


def _row(group: str, sensor: str, method: str, chosen: list[WeightSelection]) -> Row:
    weights = np.array([selection.weight for selection in chosen])
    used = weights[weights > 0]
    return {
        "drives": group,
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
