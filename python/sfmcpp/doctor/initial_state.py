"""Findings about the initial state: points without an image, and a state far from the minimum."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sfmcpp.ba.check import observations_without_image
from sfmcpp.doctor.case import Case
from sfmcpp.doctor.finding import Finding, named_points, numbers
from sfmcpp.geometry.point_tests import reprojection_errors_px
from sfmcpp.model import Problem
from sfmcpp.wording import counted

# Tens of pixels (of σ where observations are in no pixels), and of what an adjustment leaves.
_FAR_PX, _TIMES = 20.0, 10.0
_NAMED = 3


def no_image(problem: Problem) -> Iterator[Finding]:
    """Find points at the centre or at depth zero of a camera that observes them."""
    rows = observations_without_image(problem)
    if len(rows):
        points = np.unique(problem.point_index[rows])
        yield Finding(
            "no-image",
            "error",
            f"{counted(len(rows), 'observation')} of a point at the camera centre or at depth zero: the cost "
            "is undefined",
            "use --fix to drop them, or triangulate these points again",
            named_points(problem, numbers(points)),
            points=numbers(points),
            observations=numbers(rows),
        )


def far_start(case: Case) -> Iterator[Finding]:
    """Find initial states off by tens of pixels without counting outliers, and the worst cameras."""
    trial = case.sound_trial
    if trial is None:
        return
    part, good = case.part, ~trial.gross(case.sigma_px)
    if not good.any():
        return
    errors = np.minimum(reprojection_errors_px(part, part.points)[good], case.extent_px)
    rms = float(np.sqrt(np.mean(errors**2)))
    far = _FAR_PX if case.is_of_pixels else _FAR_PX * case.sigma_px
    if rms < max(far, _TIMES * trial.sigma_px):
        return
    views = np.bincount(part.camera_index[good], minlength=part.num_cameras)
    sums = np.bincount(part.camera_index[good], errors**2, part.num_cameras)
    of_cameras = np.sqrt(sums / np.maximum(views, 1))
    worst = numbers(np.argsort(-of_cameras, kind="stable")[:_NAMED])
    listed = ", ".join(f"{case.name_of_camera(k)} {of_cameras[k]:.3g} px" for k in worst)
    yield Finding(
        "far-start",
        "note",
        f"the initial state has an RMS error of {rms:.3g} px per observation ({rms / np.sqrt(2):.3g} per "
        f"coordinate, as a solve has it), a robust adjustment a median of "
        f"{trial.median_px:.3g} px; the worst cameras are {listed}",
        "nothing to do for a first estimate; if the problem was adjusted before, check whether poses, pixels "
        "or calibration have changed since",
        cameras=worst,
        measures={"rms_px": rms, "median_px": trial.median_px},
    )
