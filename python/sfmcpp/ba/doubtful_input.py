"""Warnings of calibrations and starts that cannot be right, though a solve may converge with them."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba.summary import Summary
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.uncertainty import Whitener

# Pixels so far outside their image, in its larger side, are no rounding. Of images twice as large, whose
# pixels fill them, 70 % are outside; fewer are outliers, or those of a synthetic scene with a wide view.
_MARGIN, _SHARE = 0.1, 0.3
# So many observations, evenly spread, tell a share.
_SAMPLE = 100_000
# A start is no estimate if its RMS is above this, and above that of pixels about their mean, and no fit comes
# of it.
_FAR_PX, _NO_FIT = 20.0, 0.02
# Real sets of good repute have up to 0.3 % of their observations behind a camera.
_MANY_BEHIND = 0.01
# Residuals of less than so many σ, and yet of more than so many pixels, tell nothing beside such a σ.
_NOTHING_SIGMAS, _SOMETHING_PX = 1e-3, 1e-2


def warnings_about_calibration(problem: Problem, intrinsics: FloatArray) -> list[str]:
    """Warn of pixels far outside of the images.

    Parameters
    ----------
    problem : Problem
        Its arrays kept the rules when the solve began.
    intrinsics : (G, K) float64
        Those that it was given with, which a solve may have changed.

    Returns
    -------
    list of str
    """
    if not isinstance(problem.camera_model, str) or not problem.is_metric:
        return []
    for index, end in (
        (problem.intrinsics_index, len(intrinsics)),
        (problem.camera_index, problem.num_cameras),
    ):
        if index.size and not 0 <= index.min() <= index.max() < end:
            return []  # changed by a callback since
    return list(_pixels(problem, intrinsics))


def warnings_about_result(problem: Problem, summary: Summary) -> Iterator[str]:
    """Refer to the doctor after a solve whose start, or end, no sound input explains.

    Parameters
    ----------
    problem : Problem
        As the solve has left it.
    summary : Summary
        Of that solve.

    Yields
    ------
    str
    """
    if not isinstance(problem.camera_model, str) or not problem.is_metric:
        return
    scatter = _scatter_of_pixels(problem) if summary.initial_rms_px > _FAR_PX else math.inf
    if scatter < summary.initial_rms_px < math.inf and summary.final_rms_px > _NO_FIT * scatter:
        yield (
            f"the start explains nothing: its RMS is {summary.initial_rms_px:.3g} px, that of the pixels "
            f"about their mean {scatter:.3g} px; are poses and calibration those of these images, and in the "
            "format's conventions? Run sfmcpp doctor"
        )
    elif summary.observations_behind_camera[1] > _MANY_BEHIND * problem.num_observations:
        share = summary.observations_behind_camera[1] / problem.num_observations
        yield f"{share:.1%} of the observations are behind their camera at the end; run sfmcpp doctor"


def warnings_about_sigmas(problem: Problem, summary: Summary) -> list[str]:
    """Warn of a solve that took no step because its observations have far too large σ.

    Parameters
    ----------
    problem : Problem
        With standard deviations or covariances of its observations, or without.
    summary : Summary
        Of the solve.
    """
    if len(summary.iterations) > 1 or summary.termination != "converged":
        return []
    sigmas_px = Whitener.of(problem.sigma_px, problem.covariance_px2).sigma_px
    if not len(sigmas_px):
        return []
    usual_px = float(np.median(sigmas_px))
    if summary.initial_rms_px >= _NOTHING_SIGMAS or summary.initial_rms_px * usual_px <= _SOMETHING_PX:
        return []
    return [
        f"gradient_tolerance was met before the first step, residuals are {summary.initial_rms_px:.1g} σ: "
        f"the σ of observations ({usual_px:.3g} px in the median) are so large that they say nothing"
    ]


def _scatter_of_pixels(problem: Problem) -> float:
    """RMS of a coordinate of the pixels about their mean [px]."""
    pixels = problem.pixels[:: max(problem.num_observations // _SAMPLE, 1)]
    with np.errstate(over="ignore"):  # of pixels that are none, and no reason for another warning
        return float(np.sqrt(np.mean(np.var(pixels, axis=0))))


def _pixels(problem: Problem, intrinsics: FloatArray) -> Iterator[str]:
    rows = np.arange(0, problem.num_observations, max(problem.num_observations // _SAMPLE, 1))
    outside = _far_outside(problem, intrinsics, rows)
    count = int(np.count_nonzero(outside))
    if outside.size and count > _SHARE * outside.size:
        row = int(rows[np.argmax(outside)])
        camera = int(problem.camera_index[row])
        x, y = problem.pixels[row].tolist()
        width, height = np.asarray(problem.metadata.image_sizes)[camera].tolist()
        yield (
            f"{count / outside.size:.0%} of the observations are far outside of their images: {x:.0f}, "
            f"{y:.0f} in the {width} × {height} px of camera {camera}; is the calibration of images of "
            "another size? Run sfmcpp doctor"
        )


def _far_outside(problem: Problem, intrinsics: FloatArray, rows: NDArray[np.int64]) -> BoolArray:
    """Which of some observations are far outside; empty where sizes or the corner of images are not known."""
    sizes, names = problem.metadata.image_sizes, problem.intrinsic_names
    wanted = (problem.num_cameras, 2)
    if not isinstance(sizes, np.ndarray) or sizes.shape != wanted or "cx" not in names:
        return np.zeros(0, dtype=np.bool_)
    centre = intrinsics[:, [names.index("cx"), names.index("cy")]][problem.intrinsics_index]
    of_camera = np.asarray(sizes, dtype=np.float64)
    camera, pixels = problem.camera_index[rows], problem.pixels[rows]
    known = np.all((centre > 0) & (centre < of_camera), axis=1)[camera]
    size = of_camera[camera]
    margin = _MARGIN * size.max(axis=1, keepdims=True)
    inside = (pixels > -margin) & (pixels < size + margin)
    return np.asarray(known & ~inside.all(axis=1))
