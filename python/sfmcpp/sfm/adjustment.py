"""Local and global adjustments of a growing model."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.map import LocalProblem, Map
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.weighting import solve

# Intermediate adjustments need no more digits than the next image changes.
ROUGH: dict[str, Any] = {"max_iterations": 12, "function_tolerance": 1e-3}
FINE: dict[str, Any] = {"max_iterations": 50, "function_tolerance": 1e-7}


def adjust_around(world: Map, image: int, settings: IncrementalSettings) -> LocalProblem:
    """Adjust an image, those that share most points with it, and their points; the others stay."""
    local = world.local_problem(_neighbours(world, image, settings.local_images))
    local.problem.fixed_intrinsics[:] = True
    adjusted(world, settings, local, **ROUGH)
    world.take(local)
    return local


def adjust_all(
    world: Map, settings: IncrementalSettings, *, keep_intrinsics: bool = False, **options: Any
) -> LocalProblem:
    """Adjust all images with a pose, their points, and the intrinsics of cameras with enough images."""
    local = world.whole_problem(2)
    if keep_intrinsics:
        local.problem.fixed_intrinsics[:] = True
    adjusted(world, settings, local, **options)
    world.take(local)
    return local


def adjusted(
    world: Map, settings: IncrementalSettings, local: LocalProblem | None = None, **options: Any
) -> float:
    """Adjust a part of a map, or all of it; the cost at the end. The map itself is not changed.

    Of cameras with too few images only the focal length is adjusted, and that only among enough other images.

    Raises
    ------
    KeyboardInterrupt
        If Ctrl-C ended it.
    """
    problem = (world.whole_problem(2) if local is None else local).problem
    hold_of_few_images(problem, settings)
    summary = solve(problem, loss="cauchy", loss_scale_px=settings.loss_sigmas, **options)
    return summary.require_uninterrupted().final_cost


def hold_of_few_images(problem: Problem, settings: IncrementalSettings) -> BoolArray:
    """Fix the intrinsics of cameras with too few images but for the focal length; which (G,) they are.

    Among too few other images, that too.
    """
    images = np.bincount(problem.intrinsics_index, minlength=len(problem.intrinsics))
    few = np.asarray(images < settings.intrinsics_images)
    problem.fixed_intrinsics[few, 1 if images.sum() >= settings.intrinsics_images else 0 :] = True
    return few


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
