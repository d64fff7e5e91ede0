"""What a model is worth: the same figures by the same code for every side."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import sfmcpp
from exif_positions import local_positions
from image_sets import ImageSet
from sfmcpp.errors import SfmcppError
from sfmcpp.geometry import mean_reprojection_errors_px, reprojection_errors_px
from sfmcpp.study.evaluation import ImagePoses, evaluate_model

STAGES = ("features", "matching", "mapping")


def figures(image_set: ImageSet, folder: Path, run: dict[str, Any]) -> dict[str, Any]:
    """One row of the table, as plain values; what is not known is None."""
    row: dict[str, Any] = {"set": image_set.name, "role": image_set.role, "images": len(image_set.names)}
    row |= {"given": "K" if image_set.matrix else "photos alone", "run": run, "error": run.get("error")}
    seconds = run.get("seconds", {})
    row["seconds"] = {stage: seconds.get(stage) for stage in STAGES}
    row["seconds_total"] = seconds.get("total") or sum(seconds.values()) or None
    if not run.get("models"):
        return {**row, "registered": 0}
    problem = sfmcpp.read(folder / "model")
    errors = reprojection_errors_px(problem, problem.points)
    # As COLMAP's own summary has it: the mean over the points of their mean over their images.
    of_points = mean_reprojection_errors_px(problem, problem.points)
    row |= {
        "registered": problem.num_cameras,
        "points": problem.num_points,
        "observations": problem.num_observations,
        "reprojection_px": {
            "mean": float(np.nanmean(of_points)),
            "rms": float(np.sqrt(np.mean(errors**2))),
        },
        "size": _first_size(problem),
        "intrinsics": dict(zip(problem.intrinsic_names, problem.intrinsics[0].tolist(), strict=True)),
    }
    return {**row, **_against_truth(image_set, problem)}


def _first_size(problem: sfmcpp.Problem) -> list[int] | None:
    """Width and height [px] of an image with the first intrinsics."""
    sizes = problem.metadata.image_sizes
    return None if sizes is None else sizes[int(np.argmin(problem.intrinsics_index))].tolist()


def _against_truth(image_set: ImageSet, problem: sfmcpp.Problem) -> dict[str, Any]:
    found: dict[str, Any] = {}
    try:
        if image_set.truth is not None:
            found["truth"] = evaluate_model(problem, image_set.truth).to_dict()
        if image_set.gps:
            found["gps"] = evaluate_model(problem, _gps_truth(image_set)).to_dict()["centre_error"]
    except SfmcppError as error:
        found["truth_error"] = str(error)
    return found


def _gps_truth(image_set: ImageSet) -> ImagePoses:
    """Positions as poses; their rotations mean nothing."""
    positions = local_positions(image_set.images, image_set.names)
    poses = np.tile(np.eye(3, 4), (len(positions), 1, 1))
    poses[:, :, 3] = list(positions.values())
    return ImagePoses(tuple(positions), poses)
