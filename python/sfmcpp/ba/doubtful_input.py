"""Warnings of input that cannot be right, though a solve may converge with it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from sfmcpp import _core
from sfmcpp.ba.ranks import Ranks
from sfmcpp.ba.summary import Summary
from sfmcpp.model import CameraFunction, LossFunction, Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.residual_group import Group, ResidualGroup
from sfmcpp.model.uncertainty import Whitener

# Pixels so far outside their image, in its larger side, are no rounding. Of images twice as large, whose
# pixels fill them, 70 % are outside; fewer are outliers, or those of a synthetic scene with a wide view.
_MARGIN, _SHARE = 0.1, 0.3
# Rectilinear lenses reach 65° off their axis (2.1 focal lengths), fish-eyes 110° (1.9), in the corners.
_BEYOND_LENSES, _MOST_OF_IMAGE = 4.0, 0.5
# So many observations are not all in one quadrant by chance.
_FEWEST = 50
# So many observations, evenly spread, tell a share; so many of the first mostly tell that not all are alike.
_SAMPLE, _FIRST = 10_000, 500
# A start is no estimate if its RMS is above this, and above that of pixels about their mean, and no fit comes
# of it.
_FAR_PX, _NO_FIT = 20.0, 0.02
# Real sets of good repute have up to 0.3 % of their observations behind a camera.
_MANY_BEHIND = 0.01
# Residuals of less than so many σ, and yet of more than so many pixels, tell nothing beside such a σ.
_NOTHING_SIGMAS, _SOMETHING_PX = 1e-3, 1e-2
# Of what a function gives when called again, and of its derivatives against differences, as shares of the
# largest: threads inside the function may round in another order.
_LARGEST_CHANGE = 1e-10
_LARGEST_DERIVATIVE_ERROR = 1e-3
_LITTLE_WEIGHT, _LARGEST_SHARE = 0.1, 0.5
# Tukey's weight is little from 0.83 of its scale on, that of all others with a name only farther out. If most
# errors are as large, the RMS of a coordinate is at least this part of the scale: below it nothing needs to
# be counted. Of a function nobody knows where its weight falls.
_LEAST_RMS = 0.4


def warnings_about_calibration(problem: Problem, intrinsics: FloatArray) -> list[str]:
    """Warn of focal lengths of no lens, and of pixels outside of images or from a corner that is none.

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
    if (short := short_focal(problem, intrinsics)) is not None:
        return [f"{short}. Run sfmcpp doctor"]
    return [*_pixels(problem, intrinsics), *_of_one_quadrant(problem, intrinsics)]


def short_focal(problem: Problem, intrinsics: FloatArray) -> str | None:
    """What tells that focal lengths are in another unit than pixels, or None.

    Parameters
    ----------
    problem : Problem
        Of a metric camera model with a name.
    intrinsics : (G, K) float64
        Those to look at, in the rows and columns of the problem.
    """
    if problem.num_observations < _FEWEST or "f" not in problem.intrinsic_names:
        return None
    centres = _principal_points(problem, intrinsics)
    focals = np.abs(intrinsics[:, problem.intrinsic_names.index("f")])
    x, y = problem.pixels[_sample(problem)].T
    farthest = math.hypot(_largest(x), _largest(y)) + (0.0 if centres is None else 2 * _largest(centres))
    if farthest < _BEYOND_LENSES * focals.min():
        return None
    rows = problem.intrinsics_index[problem.camera_index[_sample(problem)]]
    if centres is not None:
        x, y = x - centres[rows, 0], y - centres[rows, 1]
    with np.errstate(over="ignore"):
        largest = ((_BEYOND_LENSES * focals) ** 2)[rows]
        beyond = (x * x + y * y > largest) & (largest > 0)
    share = np.count_nonzero(beyond) / len(rows)
    if share <= _MOST_OF_IMAGE:
        return None
    focal = float(np.median(focals[rows][beyond]))
    radius = float(np.median(np.hypot(x[beyond], y[beyond])))
    angle = math.degrees(math.atan2(radius, focal))
    return (
        f"f = {focal:.4g} px, with pixels {radius:.3g} px from the principal point, is a view {angle:.0f}° "
        "off the axis, which no lens has: is f in mm? It must be in px: mm × image width [px] / sensor width "
        "[mm]"
    )


def _largest(numbers: FloatArray) -> float:
    """The largest magnitude."""
    return max(float(numbers.max()), -float(numbers.min()))


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


def warnings_about_functions(problem: Problem, constraints: Sequence[Group]) -> Iterator[str]:
    """Warn of functions of the user whose values or derivatives at the start cannot be right.

    Parameters
    ----------
    problem : Problem
        The start.
    constraints : sequence of ConstraintGroup or ResidualGroup
        All groups.

    Yields
    ------
    str
    """
    functions: dict[str, ResidualGroup | CameraFunction] = {
        f"constraints[{group.name!r}]": group for group in constraints if isinstance(group, ResidualGroup)
    }
    if isinstance(model := problem.camera_model, CameraFunction):
        functions[f"camera_model {model.name!r}"] = model
    for name, function in functions.items():
        change = function.change_when_repeated(problem)
        if change > _LARGEST_CHANGE:
            yield (
                f"{name}: its function gives other values when it is called again, by {100 * change:.2g} % "
                "of the largest: must depend on its arguments only"
            )
            continue  # differences of such values say nothing of derivatives
        error = function.derivative_error(problem)
        if error > _LARGEST_DERIVATIVE_ERROR:
            yield (
                f"{name}: the derivatives that its function gives are off by "
                f"{100 * error:.2g} % of the largest from differences: are signs, order and unit right?"
            )


def warnings_about_loss(arrays: dict[str, Any], summary: Summary, ranks: Ranks | None = None) -> list[str]:
    """Warn where most observations have hardly any weight by the loss.

    Parameters
    ----------
    arrays : dict
        Of the problem as the solve has left it.
    summary : Summary
        Of that solve.
    ranks : Ranks, optional
        The processes of which each has a part of the arrays; each calls this.

    Returns
    -------
    list of str
    """
    is_small = summary.final_rms_px < _LEAST_RMS * summary.loss_scale_px
    if summary.loss == "squared" or (is_small and not isinstance(summary.loss, LossFunction)):
        return []
    if not math.isfinite(summary.final_rms_px):
        return []  # the summary says so, and NumPy would warn of squares
    squared = np.square(_core.residuals(arrays)).sum(axis=1)
    _, weights, _ = _core.loss_terms(summary.loss, summary.loss_scale_px, squared)
    counts = np.array([np.count_nonzero(weights < _LITTLE_WEIGHT), len(weights)])
    little, count = counts if ranks is None else np.sum(ranks.everyones(counts), axis=0)
    if little <= _LARGEST_SHARE * count:
        return []
    instead = "" if summary.loss == "auto" else ', or loss "auto"'
    share, scale = f"{little / count:.0%}", f"{summary.loss_scale_px:.4g} {summary.rms_unit}"
    return [
        f"{share} of the observations are beyond the scale of the loss ({scale}) and have less than a tenth "
        f"of their weight: start from a better state, with a larger scale{instead}"
    ]


def _sample(problem: Problem) -> slice:
    return slice(None, None, max(problem.num_observations // _SAMPLE, 1))


# x and y are taken one after the other: NumPy takes ten times as long for rows of two.
def _scatter_of_pixels(problem: Problem) -> float:
    """RMS of a coordinate of the pixels about their mean [px]."""
    x, y = problem.pixels[_sample(problem)].T
    with np.errstate(over="ignore"):  # of pixels that are none, and no reason for another warning
        return float(np.sqrt((x.var() + y.var()) / 2))


def _pixels(problem: Problem, intrinsics: FloatArray) -> Iterator[str]:
    outside = _far_outside(problem, intrinsics)
    count = int(np.count_nonzero(outside))
    if outside.size and count > _SHARE * outside.size:
        row = range(problem.num_observations)[_sample(problem)][int(np.argmax(outside))]
        camera = int(problem.camera_index[row])
        x, y = problem.pixels[row].tolist()
        width, height = np.asarray(problem.metadata.image_sizes)[camera].tolist()
        yield (
            f"{count / outside.size:.0%} of the observations are far outside of their images: {x:.0f}, "
            f"{y:.0f} in the {width} × {height} px of camera {camera}; is the calibration of images of "
            "another size? Run sfmcpp doctor"
        )


def _far_outside(problem: Problem, intrinsics: FloatArray) -> BoolArray:
    """Which of the sample are far outside; empty where sizes or the corner of images are not known."""
    sizes, centres = problem.metadata.image_sizes, _principal_points(problem, intrinsics)
    wanted = (problem.num_cameras, 2)
    if not isinstance(sizes, np.ndarray) or sizes.shape != wanted or centres is None:
        return np.zeros(0, dtype=np.bool_)
    centre = centres[problem.intrinsics_index]
    of_camera = np.asarray(sizes, dtype=np.float64)
    known = np.all((centre > 0) & (centre < of_camera), axis=1)
    margin = _MARGIN * of_camera.max(axis=1)
    camera, (x, y) = problem.camera_index[_sample(problem)], problem.pixels[_sample(problem)].T
    inside = np.ones(len(camera), dtype=np.bool_)
    for pixel, size in ((x, of_camera[:, 0]), (y, of_camera[:, 1])):
        inside &= (pixel > -margin[camera]) & (pixel < (size + margin)[camera])
    return np.asarray(known[camera] & ~inside)


def _of_one_quadrant(problem: Problem, intrinsics: FloatArray) -> Iterator[str]:
    """Tell where all pixels are to one side of principal points of zero: those of NVM files may be."""
    centres = _principal_points(problem, intrinsics)
    x, y = problem.pixels[_sample(problem)].T
    if len(x) < _FEWEST or (centres is not None and centres.any()):
        return
    if _are_to_one_side(x) and _are_to_one_side(y):
        yield (
            f"principal points are 0, and all pixels to one side of them, {x.min():.0f} to {x.max():.0f} and "
            f"{y.min():.0f} to {y.max():.0f}: do they count from a corner of the image? Run sfmcpp doctor"
        )


def _are_to_one_side(pixels: FloatArray) -> bool:
    return all(some.min() >= 0 or some.max() <= 0 for some in (pixels[:_FIRST], pixels))


def _principal_points(problem: Problem, intrinsics: FloatArray) -> FloatArray | None:
    """Principal point of each row of intrinsics (G, 2) [px]; None where the camera model has none."""
    names = problem.intrinsic_names
    return intrinsics[:, [names.index("cx"), names.index("cy")]] if "cx" in names else None
