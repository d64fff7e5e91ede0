"""Adjustments of a growing model: of the images around a new one, and of all."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.map import LocalProblem, Map
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.weighting import solve

# Intermediate adjustments need no more digits than the next image changes.
_ROUGH = {"max_iterations": 12, "function_tolerance": 1e-3}
_FINE = {"max_iterations": 50, "function_tolerance": 1e-7}


def adjust_around(world: Map, image: int, settings: IncrementalSettings) -> LocalProblem:
    """Adjust an image, those that share most points with it, and their points; the others stay."""
    local = world.local_problem(_neighbours(world, image, settings.local_images))
    local.problem.fixed_intrinsics[:] = True
    _solve(world, local, settings, fine=False)
    return local


def adjust_all(
    world: Map, settings: IncrementalSettings, *, fine: bool = False, keep_intrinsics: bool = False
) -> LocalProblem:
    """Adjust all images with a pose, their points, and the intrinsics of cameras with enough images."""
    local = world.whole_problem(2)
    problem = local.problem
    images = np.bincount(problem.intrinsics_index, minlength=len(problem.intrinsics))
    few = images < settings.intrinsics_images
    problem.fixed_intrinsics[few | keep_intrinsics] = True
    _solve(world, local, settings, fine=fine)
    return local


def _neighbours(world: Map, image: int, count: int) -> NDArray[np.intp]:
    """`image`, and the images with a pose that share most points with it."""
    points = world.keypoint_points[world.keypoints_of([image])]
    seen = np.unique(points[points >= 0])
    rows = world.observations_of(seen[world.known[seen]])
    shared = np.bincount(world.keypoint_images[rows], minlength=world.num_images)
    shared[~world.registered] = 0
    shared[image] = 0
    order = np.argsort(-shared, kind="stable")[: count - 1]
    return np.append(order[shared[order] > 0], image)


def _solve(world: Map, local: LocalProblem, settings: IncrementalSettings, *, fine: bool) -> None:
    summary = solve(
        local.problem,
        loss="cauchy",
        loss_scale_px=settings.loss_px,
        **(_FINE if fine else _ROUGH),  # type: ignore[arg-type]
    )
    if summary.termination == "interrupted":
        raise KeyboardInterrupt
    world.take(local)
