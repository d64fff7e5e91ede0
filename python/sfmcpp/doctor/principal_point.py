"""Wrong fixed principal points: a free focal length hides them in the residuals, but the shape is wrong."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sfmcpp.doctor.calibration import (
    CENTRE_OFF,
    FOCAL_OFF,
    median_calibration,
    significantly_freed,
)
from sfmcpp.doctor.case import Case
from sfmcpp.doctor.finding import Finding
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray

# Lenses that are merely simplified gain a hundredth of their squared error by a free principal point.
_NOTABLE, _LARGE = 0.05, 0.5
# Cameras that share a calibration: of fewer, noise moves the principal point about.
_SHARED_BY = 4
_CENTRE = slice(2, 4)


def principal_point(case: Case) -> Iterator[Finding]:
    """Find principal points that, once free, change the focal length or halve the squared error."""
    trial = case.sound_trial
    if trial is None or case.lacks_distortion or not _may_be_tested(trial.problem):
        return
    found = significantly_freed(case, _with_free_centre, parameters=2)
    if found is None:
        return
    given, freed, less = found
    before, after = median_calibration(given), median_calibration(freed)
    focal_off = abs(np.log(after[0] / before[0])) > np.log1p(FOCAL_OFF)
    is_far = bool(focal_off or np.abs(after - before)[_CENTRE].max() > CENTRE_OFF * case.extent_px)
    if less > (_NOTABLE if is_far else _LARGE):
        case.blames_calibration = True
        yield _principal_point_finding(before, after, less, is_far)


def _may_be_tested(problem: Problem) -> bool:
    """Whether few rows of intrinsics have a free focal length, and a principal point that is fixed."""
    if problem.camera_model == "bal":
        return False
    seen = np.unique(problem.camera_index)
    rows = np.unique(problem.intrinsics_index[seen])
    fixed = problem.fixed_intrinsics[rows]
    shared = _SHARED_BY * len(rows) <= len(seen)
    return bool(shared and fixed[:, _CENTRE].all() and not fixed[:, 0].any())


def _with_free_centre(problem: Problem) -> Problem:
    fixed = problem.fixed_intrinsics.copy()
    fixed[:, _CENTRE] = False
    return replace(problem, fixed_intrinsics=fixed)


def _principal_point_finding(before: FloatArray, after: FloatArray, less: float, is_far: bool) -> Finding:
    return Finding(
        "wrong-principal-point",
        "warning" if is_far else "note",
        f"the principal point ({before[2]:.5g}, {before[3]:.5g}) contradicts the images: when refined, it "
        f"moves to ({after[2]:.5g}, {after[3]:.5g}), f from {before[0]:.5g} to {after[0]:.5g} px, and "
        f"the squared error falls by {less:.0%}",
        "check the image size and whether the images were cropped, or refine it (--refine f,cx,cy)",
        measures={
            "focal_ratio": float(after[0] / before[0]),
            "shift_x_px": float(after[2] - before[2]),
            "shift_y_px": float(after[3] - before[3]),
            "less": less,
        },
    )
