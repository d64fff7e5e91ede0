"""How long it takes to choose a weight (thesis table 5.3)."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from matplotlib.figure import Figure

import sfmcpp
from experiments.description import Experiment, Row
from experiments.report import Report
from sfmcpp.geometry import so3
from sfmcpp.model import Problem
from sfmcpp.study.plotting.style import new_figure, style_axes
from sfmcpp.weighting import PoseConstraint, PoseView, refine_pose, select_weight

NOTES = (
    "Milliseconds to choose among 100 weights, called from Python, one core: median over the runs;",
    "none: the pose alone, fitted once. The thesis has about 40 inliers in a pose (§5.2.3.2).",
)
COLUMNS = ("constraint", "method", "points", "ms")
NONE = "none"


def time_to_choose(experiment: Experiment) -> Report:
    """Time every method on poses of a synthetic scene."""
    settings = experiment.settings
    rows = [
        _row(experiment, constraint, method, points)
        for points in settings["points"]
        for constraint in settings["constraints"]
        for method in [NONE, *settings["methods"]]
    ]
    return Report(NOTES, ("constraint", "method", "points"), COLUMNS, rows, _picture(rows))


def _row(experiment: Experiment, kind: str, method: str, points: int) -> Row:
    seconds = [_seconds(_task(kind, method, points, seed)) for seed in experiment.seeds]
    return {"constraint": kind, "method": method, "points": points, "ms": 1e3 * float(np.median(seconds))}


def _seconds(task: Callable[[], object]) -> float:
    task()  # memory and caches as in a run
    started = time.perf_counter()
    task()
    return time.perf_counter() - started


def _task(kind: str, method: str, points: int, seed: int) -> Callable[[], object]:
    scene = sfmcpp.circle_scene(2, points, focal_px=600, pixel_sigma_px=0.5, seed=seed)
    view = _view(scene)
    previous, start = scene.cameras
    turn = previous[:, :3].T @ start[:, :3] @ so3.exp(np.array([0.002, -0.001, 0.003]))
    constraint = PoseConstraint(
        kind,
        rotation=turn if kind.startswith("displacement") else start[:, :3],
        distance=1.01 * float(np.linalg.norm(start[:, 3] - previous[:, 3])),
        previous=previous,
        points=scene.points,
        intrinsics=scene.intrinsics[0],
    )
    if method == NONE:
        return lambda: refine_pose(view, [(constraint, 1.0)], start)
    return lambda: select_weight(view, constraint, start, method)


def _view(scene: Problem) -> PoseView:
    seen = scene.camera_index == 1
    return PoseView(scene.points[scene.point_index[seen]], scene.pixels[seen], scene.intrinsics[1])


def _picture(rows: list[Row]) -> Figure:
    """Figure 5.9: the time over the number of points, a panel for each constraint."""
    constraints = list(dict.fromkeys(row["constraint"] for row in rows))
    figure = new_figure(3.2 * len(constraints), 3.4)
    panels = np.atleast_1d(figure.subplots(1, len(constraints), sharey=True))
    for axes, constraint in zip(panels, constraints, strict=True):
        for method in dict.fromkeys(row["method"] for row in rows):
            same = [row for row in rows if (row["constraint"], row["method"]) == (constraint, method)]
            axes.plot([row["points"] for row in same], [row["ms"] for row in same], "o-", label=method)
        axes.set_yscale("log")
        axes.set_title(constraint, fontsize=9)
        axes.set_xlabel("points")
        style_axes(axes)
    panels[0].set_ylabel("milliseconds")
    panels[0].legend(frameon=False, fontsize=8)
    return figure
