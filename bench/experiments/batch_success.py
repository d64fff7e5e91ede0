"""How often batch structure from motion succeeds, against missing data and wrong observations."""

from __future__ import annotations

import time

import numpy as np
from matplotlib.figure import Figure

from experiments.description import Experiment, Row
from experiments.measures import mean
from experiments.pictures import grouped_bars
from experiments.report import Report
from experiments.starts import true_scene
from sfmcpp import Problem
from sfmcpp.geometry import fit_similarity
from sfmcpp.model.image_tracks import ImageTracks, image_tracks
from sfmcpp.sfm.batch.projective import reconstruct_projective
from sfmcpp.sfm.batch.upgrade import metric_upgrade
from sfmcpp.study.plotting.style import new_figure, style_axes

NOTES = (
    "missing: share of the images that do not see a track; those do that are nearest to one of them.",
    "wrong: share of the observations that are anywhere in the image. Nothing is known of cameras but the",
    "size of the images. projective: all images have a camera. metric: all centres lie within 5 % of the",
    "distance to the scene, after a similarity, and the focal length within 5 %. focal_error, centre_error:",
    "medians of what was reconstructed, over the true focal length and that distance.",
)
COLUMNS = (
    "scene", "missing", "wrong", "runs", "projective", "metric", "focal_error", "centre_error", "seconds",
)  # fmt: skip
CLOSE = 0.05


def share_of_metric_success(experiment: Experiment) -> Report:
    """Reconstruct every scene with every share of missing and of wrong observations."""
    settings = experiment.settings
    rows = [
        {"scene": kind, "missing": missing, "wrong": wrong, **_row(experiment, kind, missing, wrong)}
        for kind in settings["scenes"]
        for missing in settings["missing"]
        for wrong in settings["wrong"]
    ]
    return Report(NOTES, ("scene", "missing", "wrong"), COLUMNS, rows, _picture(rows))


def _row(experiment: Experiment, kind: str, missing: float, wrong: float) -> Row:
    runs = [_run(experiment, kind, missing, wrong, seed) for seed in experiment.seeds]
    known = [run for run in runs if run["focal_error"] is not None]
    return {
        "runs": len(runs),
        **{name: sum(run[name] for run in runs) for name in ("projective", "metric")},
        **{
            name: float(np.median([run[name] for run in known])) if known else None
            for name in ("focal_error", "centre_error")
        },
        "seconds": mean(run["seconds"] for run in runs),
    }


def _run(experiment: Experiment, kind: str, missing: float, wrong: float, seed: int) -> Row:
    truth = true_scene(experiment, seed, kind)
    sizes = truth.metadata.image_sizes
    assert sizes is not None
    tracks = _tracks(truth, missing, wrong, seed)
    started = time.perf_counter()
    found = reconstruct_projective(tracks, threads=1)
    complete = len(found.images) == truth.num_cameras
    failed: Row = {"projective": complete, "metric": False, "focal_error": None, "centre_error": None}
    upgrade = metric_upgrade(found.problem, sizes[found.images], threads=1) if found.problem else None
    failed["seconds"] = time.perf_counter() - started
    if upgrade is None or upgrade.problem is None:
        return failed
    images = found.images[upgrade.cameras]
    place = fit_similarity(upgrade.problem.centres, truth.centres[images])
    distances = np.linalg.norm(place.apply(upgrade.problem.centres) - truth.centres[images], axis=1)
    centre = float(distances.max() / np.linalg.norm(truth.centres, axis=1).mean())
    focal = abs(float(upgrade.problem.intrinsics[0, 0] / truth.intrinsics[0, 0]) - 1)
    good = len(images) == truth.num_cameras and max(centre, focal) < CLOSE
    return {**failed, "metric": good, "focal_error": focal, "centre_error": centre}


def _tracks(truth: Problem, missing: float, wrong: float, seed: int) -> ImageTracks:
    """Observations by the images nearest to one that is chosen for each point, some of them anywhere."""
    rng = np.random.default_rng([seed, 1])
    count = truth.num_cameras
    kept_images = max(round(count * (1 - missing)), 3)
    steps = np.linalg.norm(truth.centres[:, None] - truth.centres, axis=2)
    nearest = np.argsort(steps, axis=1, kind="stable")[:, :kept_images]
    sees = np.zeros((truth.num_points, count), dtype=np.bool_)
    np.put_along_axis(sees, nearest[rng.integers(count, size=truth.num_points)], True, axis=1)
    rows = np.flatnonzero(sees[truth.point_index, truth.camera_index])
    pixels, images = truth.pixels[rows].copy(), truth.camera_index[rows]
    sizes = truth.metadata.image_sizes
    assert sizes is not None
    spoilt = rng.random(len(rows)) < wrong
    pixels[spoilt] = rng.uniform(size=(np.count_nonzero(spoilt), 2)) * sizes[images[spoilt]]
    return image_tracks(images, truth.point_index[rows], pixels, sizes=sizes)


def _picture(rows: list[Row]) -> Figure:
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    shares = list(dict.fromkeys(row["missing"] for row in rows))
    figure = new_figure(5.2 * len(scenes), 4.0)
    panels = figure.subplots(1, len(scenes), sharey=True, squeeze=False)[0]
    for axes, scene in zip(panels, scenes, strict=True):
        heights: dict[str, list[float]] = {}
        for row in (row for row in rows if row["scene"] == scene):
            heights.setdefault(f"{row['wrong']:.0%} wrong", []).append(row["metric"] / row["runs"])
        grouped_bars(axes, heights)
        style_axes(axes)
        axes.set_xticks(range(len(shares)), [f"{share:.0%}" for share in shares])
        axes.set_xlabel("missing")
        axes.set_title(scene, fontsize=10)
    panels[0].set_ylabel("share of success")
    panels[0].legend(fontsize=8, frameon=False)
    return figure
