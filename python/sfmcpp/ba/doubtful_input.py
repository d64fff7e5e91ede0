"""Warnings of calibrations that cannot be right, though a solve may converge with them."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray

# Pixels so far outside their image, in its larger side, are no rounding; single ones are outliers.
_MARGIN, _SHARE = 0.1, 0.01


def warnings_about_calibration(problem: Problem) -> list[str]:
    """Warn of focal lengths that are not positive, and of pixels far outside of the images.

    Parameters
    ----------
    problem : Problem
        At the state that it was given in; its arrays keep the rules.

    Returns
    -------
    list of str
    """
    if not isinstance(problem.camera_model, str) or not problem.is_metric:
        return []
    return [*_focal_lengths(problem), *_pixels(problem)]


def _focal_lengths(problem: Problem) -> Iterator[str]:
    focals = problem.intrinsics[:, problem.intrinsic_names.index("f")][problem.intrinsics_index]
    wrong = np.flatnonzero((focals <= 0) & (np.bincount(problem.camera_index, minlength=len(focals)) > 0))
    if len(wrong):
        row = problem.intrinsics_index[wrong[0]]
        yield (
            f"the focal length of {len(wrong):,} of {len(focals):,} cameras is not positive: f = "
            f"{focals[wrong[0]]:g} px in intrinsics[{row}]; run sfmcpp doctor"
        )


def _pixels(problem: Problem) -> Iterator[str]:
    outside = _far_outside(problem)
    count = int(np.count_nonzero(outside))
    if outside.size and count > _SHARE * outside.size:
        row = int(np.argmax(outside))
        camera = int(problem.camera_index[row])
        x, y = problem.pixels[row].tolist()
        width, height = np.asarray(problem.metadata.image_sizes)[camera].tolist()
        yield (
            f"{count / outside.size:.0%} of the observations are far outside of their images: {x:.0f}, "
            f"{y:.0f} in the {width} × {height} px of camera {camera}; is the calibration of images of "
            "another size? Run sfmcpp doctor"
        )


def _far_outside(problem: Problem) -> BoolArray:
    """(M,) observations far outside; empty where sizes are not known or pixels do not count from a corner."""
    sizes, names = problem.metadata.image_sizes, problem.intrinsic_names
    if sizes is None or np.shape(sizes) != (problem.num_cameras, 2) or "cx" not in names:
        return np.zeros(0, dtype=np.bool_)
    centre = problem.intrinsics[:, [names.index("cx"), names.index("cy")]][problem.intrinsics_index]
    of_camera = np.asarray(sizes, dtype=np.float64)
    known = np.all((centre > 0) & (centre < of_camera), axis=1)[problem.camera_index]
    size = of_camera[problem.camera_index]
    margin = _MARGIN * size.max(axis=1, keepdims=True)
    inside = (problem.pixels > -margin) & (problem.pixels < size + margin)
    return np.asarray(known & ~inside.all(axis=1))
