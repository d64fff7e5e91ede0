"""How often batch factorisation finds the projective world of synthetic tracks with holes and outliers."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product

import numpy as np
from matplotlib.figure import Figure

import sfmcpp
from experiments.description import Experiment, Row
from experiments.measures import mean
from experiments.report import Report
from experiments.runs import FloatArray
from sfmcpp import Problem
from sfmcpp.model.image_tracks import image_tracks
from sfmcpp.sfm.batch.projective import ProjectiveReconstruction, reconstruct_projective
from sfmcpp.sources.synthetic import hide_observations
from sfmcpp.study.evaluation.projective import projective_errors_px
from sfmcpp.study.plotting.style import new_figure, style_axes

LEAST_IMAGES, LEAST_RECALL, LARGEST_RATIO = 0.9, 0.75, 1.5
# Normal deviate of a two-sided interval of 95 %.
_DEVIATE = 1.96
NOTES = (
    "missing: share of all pairs of an image and a point without an observation.",
    "share: of the runs that succeed, low to high its 95 % interval (Wilson). A run succeeds with cameras",
    f"  for {LEAST_IMAGES:.0%} of the images, {LEAST_RECALL:.0%} of the right observations kept, and an",
    f"  error of at most {LARGEST_RATIO:g} times that of the adjustment of the same observations that starts",
    "  from the truth, both after the best homography.",
    "error_ratio: the median of it. images, recall, wrong: means of the shares of images with a camera,",
    "  of right observations kept, of wrong ones among those kept.",
)
COLUMNS = (
    "scene",
    "missing",
    "noise_px",
    "outliers",
    "runs",
    "share",
    "low",
    "high",
    "error_ratio",
    "images",
    "recall",
    "wrong",
    "seconds",
)


@dataclass(frozen=True)
class _Case:
    """A scene with holes, noise and outliers."""

    scene: Row
    missing: float
    noise_px: float
    outliers: float


@dataclass(frozen=True)
class _Outcome:
    """What became of one run."""

    images: float
    recall: float
    wrong: float
    ratio: float | None
    missing: float
    seconds: float

    @property
    def succeeded(self) -> bool:
        found = self.images >= LEAST_IMAGES and self.recall >= LEAST_RECALL
        return found and self.ratio is not None and self.ratio <= LARGEST_RATIO


def share_of_success(experiment: Experiment) -> Report:
    """Reconstruct every seed of every scene at every level of missing data, noise and outliers."""
    rows = [_row(case, [_run(case, seed) for seed in experiment.seeds]) for case in _cases(experiment)]
    identity = ("scene", "missing", "noise_px", "outliers")
    return Report(NOTES, identity, COLUMNS, rows, _picture(rows))


def interval(successes: int, runs: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a share."""
    share, squared = successes / runs, _DEVIATE**2 / runs
    middle = (share + squared / 2) / (1 + squared)
    half = _DEVIATE / (1 + squared) * np.sqrt(share * (1 - share) / runs + squared / (4 * runs))
    return max(0.0, float(middle - half)), min(1.0, float(middle + half))


def _cases(experiment: Experiment) -> Iterator[_Case]:
    settings = experiment.settings
    for scene in settings["scenes"]:
        for missing, noise in product(scene["missing"], settings["noise"]):
            yield _Case(scene, missing, noise["pixel_sigma_px"], noise["outliers"])


def _run(case: _Case, seed: int) -> _Outcome:
    truth = _scene(case, seed)
    seen, is_wrong = sfmcpp.add_outliers(truth, case.outliers, seed=seed)
    tracks = image_tracks(seen.camera_index, seen.point_index, seen.pixels)
    start = time.perf_counter()
    found = reconstruct_projective(tracks, seed=seed, threads=1)
    seconds = time.perf_counter() - start
    missing = 1 - truth.num_observations / (truth.num_cameras * truth.num_points)
    if found.problem is None:
        return _Outcome(0.0, 0.0, 0.0, None, missing, seconds)
    wrong = is_wrong[found.observations]
    return _Outcome(
        len(found.images) / truth.num_cameras,
        float(np.count_nonzero(~wrong) / np.count_nonzero(~is_wrong)),
        float(wrong.mean()),
        _error_ratio(found, found.problem, truth, wrong),
        missing,
        seconds,
    )


def _scene(case: _Case, seed: int) -> Problem:
    arguments = dict(case.scene)
    kind, pattern = arguments.pop("kind"), arguments.pop("pattern")
    del arguments["name"], arguments["missing"]
    first = arguments.pop("first_cameras", None)
    scene = sfmcpp.SCENES[kind](**arguments, pixel_sigma_px=case.noise_px, seed=seed)
    if first is not None:
        scene = _of_first_cameras(scene, first)
    return scene if pattern == "depth" else hide_observations(scene, case.missing, pattern=pattern, seed=seed)


def _of_first_cameras(scene: Problem, count: int) -> Problem:
    """The problem of the first cameras alone."""
    seen = scene.camera_index < count
    result = Problem(
        scene.camera_model,
        scene.cameras[:count],
        scene.intrinsics[:count],
        scene.points,
        scene.camera_index[seen],
        scene.point_index[seen],
        scene.pixels[seen],
    )
    sizes = scene.metadata.image_sizes
    assert sizes is not None
    result.metadata.image_sizes = sizes[:count]
    return result


def _error_ratio(
    found: ProjectiveReconstruction, problem: Problem, truth: Problem, wrong: FloatArray
) -> float:
    """Error after the best homography over that of the adjustment from the truth, right observations alone.

    Points with a wrong observation are left out of both.
    """
    same = Problem(
        truth.camera_model,
        truth.cameras[found.images],
        truth.intrinsics[found.images],
        truth.points[found.tracks],
        problem.camera_index,
        problem.point_index,
        truth.pixels[found.observations],
    )
    spoilt = np.bincount(problem.point_index, wrong, problem.num_points) > 0
    right = ~spoilt[problem.point_index]
    best = sfmcpp.as_projective(same)
    sfmcpp.solve(best, method="dog-leg", max_iterations=100, threads=1)
    errors, reference = (projective_errors_px(p, same, right)[right] for p in (problem, best))
    return float(np.sqrt(np.mean(errors**2) / np.mean(reference**2)))


def _row(case: _Case, outcomes: list[_Outcome]) -> Row:
    succeeded = sum(outcome.succeeded for outcome in outcomes)
    low, high = interval(succeeded, len(outcomes))
    ratios = [outcome.ratio for outcome in outcomes if outcome.ratio is not None]
    return {
        "scene": case.scene["name"],
        "missing": round(float(np.mean([outcome.missing for outcome in outcomes])), 3),
        "noise_px": case.noise_px,
        "outliers": case.outliers,
        "runs": len(outcomes),
        "succeeded": succeeded,
        "share": succeeded / len(outcomes),
        "low": low,
        "high": high,
        "error_ratio": float(np.median(ratios)) if ratios else None,
        "images": mean(outcome.images for outcome in outcomes),
        "recall": mean(outcome.recall for outcome in outcomes),
        "wrong": mean(outcome.wrong for outcome in outcomes),
        "seconds": mean(outcome.seconds for outcome in outcomes),
    }


def _picture(rows: list[Row]) -> Figure:
    """Share of success over what is missing, a panel for each scene."""
    scenes = list(dict.fromkeys(row["scene"] for row in rows))
    figure = new_figure(3.4 * len(scenes), 3.8)
    panels = figure.subplots(1, len(scenes), sharey=True, squeeze=False)[0]
    for axes, scene in zip(panels, scenes, strict=True):
        here = [row for row in rows if row["scene"] == scene]
        for noise in dict.fromkeys((row["noise_px"], row["outliers"]) for row in here):
            line = [row for row in here if (row["noise_px"], row["outliers"]) == noise]
            shares = np.array([row["share"] for row in line])
            bars = np.abs([[row["low"], row["high"]] for row in line] - shares[:, None]).T
            at = [100 * row["missing"] for row in line]
            label = f"{noise[0]:g} px, {noise[1]:.0%} outliers"
            axes.errorbar(at, shares, bars, capsize=3, marker="o", markersize=4, label=label)
        style_axes(axes)
        axes.set_title(scene, fontsize=10)
        axes.set_xlabel("percent missing")
    panels[0].set_ylabel("share of success")
    panels[0].set_ylim(-0.05, 1.05)
    panels[0].legend(fontsize=8, frameon=False, loc="lower left")
    return figure
