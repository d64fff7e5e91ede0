"""Pixels of images of another size: photos that were resized after their calibration."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sfmcpp.doctor.case import Case, image_sizes_px
from sfmcpp.doctor.finding import Finding
from sfmcpp.doctor.trial import adjusted
from sfmcpp.geometry.point_tests import reprojection_errors_px
from sfmcpp.model import Problem

# Keypoints of all images together come near to every side; sizes are rounded, and crops leave a little.
_FILLED = (0.8, 1.05)
# Nobody makes photos smaller than this: then pixels are something else.
_SMALLEST = 0.05
# Of what a scale makes: both sides are filled about as far, and from the corner that pixels count from.
_AS_FAR, _CORNER = 0.5, 0.1
# A part of the images may be empty for other reasons: then K so scaled fits no better.
_BETTER = 0.8
# Fewer observations may leave a part of the images empty by chance.
_LEAST_OBSERVATIONS = 100
_NEARLY_ALL = (0.002, 0.998)


def image_fill(case: Case) -> Iterator[Finding]:
    """Find pixels that fill only a part of the images or exceed them, where a scaled K fits better."""
    if case.is_misread or case.problem.camera_model == "bal":
        return
    scale = _apparent_scale(case.sample)
    if scale is None:
        return
    medians = _medians_px(case, scale)
    if medians is None:
        return
    case.is_misread = True
    rounded = float(f"{scale:.2g}")  # keypoints tell no more digits
    reached = np.quantile(case.sample.pixels, _NEARLY_ALL[1], axis=0)
    width, height = np.median(image_sizes_px(case.sample), axis=0)
    yield Finding(
        "pixels-of-another-size",
        "warning",
        f"the pixels belong to images {rounded:g} times as large (they reach {reached[0]:.0f}, "
        f"{reached[1]:.0f} in images of {width:.0f} × {height:.0f} px): the median error is {medians[0]:.3g} "
        f"px, and {medians[1]:.3g} px with f, cx and cy scaled by this factor",
        f"multiply the pixels by {1 / rounded:.3g}, or f, cx, cy and the image sizes by {rounded:g}: the "
        "photos were resized after their calibration",
        measures={"scale": scale, "median_px": medians[0], "median_scaled_px": medians[1]},
    )


def _medians_px(case: Case, scale: float) -> tuple[float, float] | None:
    """Median errors as it is and with K scaled [px], at the start or adjusted; None where K fits as well."""
    scaled = _with_scaled_calibration(case.sample, scale)
    before, after = (float(np.median(reprojection_errors_px(p, p.points))) for p in (case.sample, scaled))
    if after < _BETTER * before:
        return before, after
    fitted = adjusted(_with_scaled_calibration(case.part, scale), case.constraints)
    if case.trial is None or isinstance(fitted, str) or fitted.median_px > _BETTER * case.trial.median_px:
        return None
    return case.trial.median_px, fitted.median_px


def _apparent_scale(problem: Problem) -> float | None:
    """Apparent scale of the images of the pixels; None if it is that of the problem."""
    sizes = image_sizes_px(problem)
    if len(sizes) < _LEAST_OBSERVATIONS:
        return None
    low, high = np.quantile(problem.pixels / sizes, _NEARLY_ALL, axis=0)
    filled = float(high.max())
    uneven = high.min() < _AS_FAR * filled or low.max() > _CORNER * filled or low.min() < -_CORNER * filled
    unscaled = filled < _SMALLEST or _FILLED[0] < filled < _FILLED[1]
    return None if uneven or unscaled else filled


def _with_scaled_calibration(problem: Problem, scale: float) -> Problem:
    intrinsics = problem.intrinsics.copy()
    intrinsics[:, [0, 2, 3]] *= scale
    return replace(problem, intrinsics=intrinsics)
