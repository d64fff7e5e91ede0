"""Local and global adjustments of a growing model."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.map import LocalProblem, Map
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.sfm.stops import heed_stop
from sfmcpp.weighting import solve

# Intermediate adjustments need no more digits than the next image changes.
ROUGH: dict[str, Any] = {"max_iterations": 12, "function_tolerance": 1e-3}
FINE: dict[str, Any] = {"max_iterations": 50, "function_tolerance": 1e-7}
# Observations of points that are known without a camera, from which its few images tell how its lens bends.
_TIED = 100
# Focal lengths of lenses in lengths of the longer side: shorter ones see 150° and more, which none draws with
# straight lines, longer ones are those of telescopes.
_LENSES = 0.13, 50.0
# No lens moves the corners of an image by more than so many times their distance from the middle.
_MOST_MOVED = 2.0
_K1 = PERSPECTIVE.index("k1")


def adjust_around(world: Map, image: int, settings: IncrementalSettings) -> LocalProblem:
    """Adjust an image, those that share most points with it, and their points; the others stay.

    A stop leaves what has been reached.
    """
    local = world.local_problem(_neighbours(world, image, settings.local_images))
    local.problem.fixed_intrinsics[:] = True
    try:
        adjusted(world, settings, local, **ROUGH)
    finally:
        world.take(local)
    return local


def adjust_all(world: Map, settings: IncrementalSettings, **options: Any) -> LocalProblem:
    """Adjust all images with a pose, their points, and the intrinsics of cameras with enough images.

    Where distortion becomes that of no lens, there is none from then on: images that were taken along the way
    that the camera looks leave it open beside the focal length, and all points would be outliers then.

    A stop leaves what has been reached, or what was before.
    """
    local, impossible = _adjusted_all(world, settings, keep_intrinsics=False, **options)
    world.fixed_intrinsics[local.cameras[impossible], _K1:] = True
    return local


def adjust_young(
    world: Map, settings: IncrementalSettings, *, keep_intrinsics: bool = False, **options: Any
) -> LocalProblem:
    """Adjust all of a model that grows, with all intrinsics held where a focal length became that of no lens.

    More images tell them. A stop leaves what has been reached.
    """
    before = world.intrinsics.copy(), world.poses.copy(), world.points.copy()
    local, _ = _adjusted_all(world, settings, keep_intrinsics=keep_intrinsics, **options)
    free, focals = ~local.problem.fixed_intrinsics[:, 0], local.problem.intrinsics[:, 0]
    if (free & impossible_focals(focals, world.camera_sizes[local.cameras].max(axis=1))).any():
        world.intrinsics[:], world.poses[:], world.points[:] = before
        local, _ = _adjusted_all(world, settings, keep_intrinsics=True, **options)
    return local


def _adjusted_all(
    world: Map, settings: IncrementalSettings, *, keep_intrinsics: bool, **options: Any
) -> tuple[LocalProblem, BoolArray]:
    """What has been adjusted, and (G,) which of its cameras lost an impossible distortion."""
    local = world.whole_problem(2)
    if keep_intrinsics:
        local.problem.fixed_intrinsics[:] = True
    try:
        adjusted(world, settings, local, **options)
    finally:
        impossible = _has_impossible_distortion(local.problem, world.camera_sizes[local.cameras])
        if not impossible.any():
            world.take(local)
    if impossible.any():
        local = world.whole_problem(2)
        local.problem.intrinsics[impossible, _K1:] = 0.0
        local.problem.fixed_intrinsics[impossible, _K1:] = True
        adjusted(world, settings, local, **options)
        world.take(local)
    return local, impossible


def impossible_focals(focals_px: FloatArray, sides_px: FloatArray) -> BoolArray:
    """(n,) which focal lengths no lens has before images of such longer sides; 0 px: unknown, any may."""
    shortest, longest = (sides_px * limit for limit in _LENSES)
    return np.asarray((sides_px > 0) & ((focals_px < shortest) | (focals_px > longest)))


def _has_impossible_distortion(problem: Problem, sizes: NDArray[np.int64]) -> BoolArray:
    """(G,) which cameras have a free k1 that no lens has, in images of `sizes` (G, 2)."""
    focals, k1 = problem.intrinsics[:, 0], problem.intrinsics[:, _K1]
    corners = np.hypot(*(sizes / 2).T) / focals
    return np.asarray(~problem.fixed_intrinsics[:, _K1] & (np.abs(k1) * corners**2 > _MOST_MOVED))


def adjusted(
    world: Map, settings: IncrementalSettings, local: LocalProblem | None = None, **options: Any
) -> float:
    """Adjust a part of a map, or all of it; the cost at the end. The map itself is not changed.

    Of cameras with too few images only the focal length is adjusted, and that only among enough other images.

    Raises
    ------
    KeyboardInterrupt
        If Ctrl-C ended it, or a stop that :func:`stopped_by` hears of.
    """
    problem = (world.whole_problem(2) if local is None else local).problem
    hold_of_few_images(problem, settings)
    summary = solve(problem, loss="cauchy", loss_scale_px=settings.loss_sigmas, callback=heed_stop, **options)
    return summary.require_uninterrupted().final_cost


def hold_of_few_images(problem: Problem, settings: IncrementalSettings) -> BoolArray:
    """Fix the intrinsics of cameras with too few images but for the focal length; which (G,) they are.

    Among too few other images, that too. Where other images hold most of what a camera sees, its first radial
    coefficient stays free as well: held at zero, that of a real lens would bend the whole model.
    """
    images = np.bincount(problem.intrinsics_index, minlength=len(problem.intrinsics))
    few = np.asarray(images < settings.intrinsics_images)
    known = problem.fixed_intrinsics[:, _K1].copy()
    enough = images.sum() >= settings.intrinsics_images
    problem.fixed_intrinsics[few, 1 if enough else 0 :] = True
    if enough:
        tied = few & (_shared_observations(problem) >= _TIED)
        problem.fixed_intrinsics[tied, _K1] = known[tied]
    return few


def fix_what_few_images_held(world: Map, settings: IncrementalSettings) -> None:
    """Mark the intrinsics that no adjustment has changed as fixed, once there are no more adjustments."""
    local = world.whole_problem(2)
    hold_of_few_images(local.problem, settings)
    world.fixed_intrinsics[local.cameras] = local.problem.fixed_intrinsics


def _shared_observations(problem: Problem) -> IndexArray:
    """Numbers (G,) of observations of each camera's images of points that two other images see, too."""
    views = np.bincount(problem.point_index, minlength=problem.num_points)
    shared = views[problem.point_index] > 2
    cameras = problem.intrinsics_index[problem.camera_index[shared]]
    return np.bincount(cameras, minlength=len(problem.intrinsics)).astype(np.int32)


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
