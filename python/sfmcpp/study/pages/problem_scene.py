"""The scene of a problem for the page of a model: what a file holds, without the photos."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from sfmcpp.ba import residuals_px
from sfmcpp.errors import DatasetError
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sources.io.checks import image_names, point_colors, require_valid
from sfmcpp.sources.io.intrinsics import lenses_from_corner, perspective_columns
from sfmcpp.study.pages.model_page import ModelScene, corners_at_distance_one, save_model_page

_BLACK = (0, 0, 0)  # the page shows points without any colour in a pale one


def write_problem_page(problem: Problem, path: Path, title: str) -> None:
    """Write a page of a problem in three dimensions: points that are seen, cameras and their mean errors.

    Parameters
    ----------
    problem : Problem
        Its images are as large as its metadata say, or else as its observations ask for. Metres and north
        are shown where positions have told its world.
    path : Path
        Where to.
    title : str
        Heading of the page.

    Raises
    ------
    DatasetError
        If the cameras are projective, metadata do not fit the problem, or the file cannot be written.
    """
    save_model_page(_scene(problem, path, title), path)


def require_world(problem: Problem, path: Path) -> None:
    """Raise a DatasetError if a problem has projective cameras, whose world is no place to show."""
    if not problem.is_metric:
        raise DatasetError(path, f"{problem.camera_model} cameras have no world to show")


def _scene(problem: Problem, path: Path, title: str) -> ModelScene:
    require_world(problem, path)
    require_valid(problem, path)
    errors = np.linalg.norm(residuals_px(problem), axis=1)
    seen = np.bincount(problem.point_index, minlength=problem.num_points) > 0
    origin = WorldOrigin.of(problem.metadata)
    facts = {
        "cameras": f"{problem.num_cameras:,}",
        "points": f"{np.count_nonzero(seen):,}",
        "mean error": f"{errors.mean():.3g} px" if len(errors) else "no observations",
    }
    return ModelScene(
        title,
        problem.points[seen],
        point_colors(problem, _BLACK, path)[seen],
        problem.cameras,
        _corners(problem, path),
        image_names(problem, path),
        _notes(problem, errors),
        [None] * problem.num_cameras,
        facts,
        "" if origin is None else "m",
        origin is not None and origin.geodetic,
    )


def _corners(problem: Problem, path: Path) -> FloatArray:
    """(C, 4) left, top, right and bottom of images at distance 1 from their cameras, without distortion."""
    lenses = lenses_from_corner(problem, path)
    f, aspect, cx, cy = lenses.values[:, perspective_columns("f", "aspect", "cx", "cy")].T
    width, height = np.asarray(lenses.sizes, dtype=np.float64).T
    return corners_at_distance_one(f, aspect, cx, cy, width, height)[problem.intrinsics_index]


def _notes(problem: Problem, errors: FloatArray) -> list[str]:
    counts = np.bincount(problem.camera_index, minlength=problem.num_cameras)
    sums = np.bincount(problem.camera_index, errors, minlength=problem.num_cameras)
    return [
        f"{count:,} observations" + (f", mean error {total / count:.3g} px" if count else "")
        for count, total in zip(counts.tolist(), sums.tolist(), strict=True)
    ]
