"""Radial distortion that is held at zero or at a wrong value: the scene bends to absorb the difference.

It comes before focal lengths and principal points, which take up a part of it where they are freed.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sfmcpp.doctor.calibration import adjusted_with_free_calibration, significantly_freed
from sfmcpp.doctor.case import Case
from sfmcpp.doctor.finding import Finding
from sfmcpp.doctor.trial import (
    BENDS,
    Trial,
    as_perspective,
    may_be_perspective,
    moved_at_border,
    radii_px,
)
from sfmcpp.model import Problem
from sfmcpp.model.camera_models import PERSPECTIVE

# Part of the squared error by which it must fall: that of lenses of a few tenths of a pixel falls by less.
_NOTABLE = 0.1
_F, _K1 = PERSPECTIVE.index("f"), PERSPECTIVE.index("k1")


def distortion(case: Case) -> Iterator[Finding]:
    """Find a held radial distortion that, once free, explains more than any other focal length."""
    trial = case.sound_trial
    if trial is None or not _may_be_tested(trial.problem):
        return
    found = significantly_freed(case, _with_free_distortion, parameters=1)
    if found is None:
        return
    given, freed, less = found
    if less > _NOTABLE and not _focal_explains_more(case, case.good_part, freed):
        case.lacks_distortion = True
        yield _finding(given.problem, freed.problem, less)


def _may_be_tested(problem: Problem) -> bool:
    """Whether the cameras that observe are pinholes whose distortion is held."""
    if not may_be_perspective(problem):
        return False
    rows = np.unique(problem.intrinsics_index[problem.camera_index])
    return bool(problem.fixed_intrinsics[rows, _K1:].all())


def _with_free_distortion(problem: Problem) -> Problem:
    problem = as_perspective(problem)
    problem.fixed_intrinsics[:, _K1] = False
    return problem


def _focal_explains_more(case: Case, good: Problem, freed: Trial) -> bool:
    """Whether a held focal length and principal point, once free, explain more than the distortion does."""
    if not good.fixed_intrinsics[:, _F].all():
        return False
    other = adjusted_with_free_calibration(case, good)
    return other is not None and case.squared_error(other) < case.squared_error(freed)


def _finding(given: Problem, freed: Problem, less: float) -> Finding:
    rows = freed.intrinsics_index[np.unique(freed.camera_index)]
    k1, f = np.median(freed.intrinsics[rows][:, [_K1, _F]], axis=0)
    held_k1 = given.intrinsics[:, _K1] if given.intrinsics.shape[1] > _K1 else np.zeros(len(given.intrinsics))
    before = float(np.median(held_k1[rows]))
    radii = radii_px(freed)
    row = freed.intrinsics[freed.intrinsics_index]
    more = np.abs(row[:, _K1] - held_k1[freed.intrinsics_index])
    moved = more * moved_at_border(_K1, row[:, _F], radii)
    held = bool(given.fixed_intrinsics[rows, _F].all())
    return Finding(
        "wrong-distortion" if before else "missing-distortion",
        "warning" if moved.max() > BENDS else "note",
        f"k1 is held at {before:.3g} and contradicts the images: {k1:.3g} fits them and moves pixels at the "
        f"border by {(moved * radii).max():.2g} px; the squared error falls by {less:.0%}; without it the "
        "scene bends",
        "refine it, with the focal length (--refine f,k1)" if held else "refine it (--refine f,k1)",
        measures={"k1": float(k1), "focal_px": float(f), "less": less, "moved": float(moved.max())},
    )
