"""New points, the local adjustment, and what it shows to be wrong."""

from __future__ import annotations

import numpy as np

from sfmcpp.ba import Summary
from sfmcpp.geometry import refine_points, reliable_points, reprojection_errors_px, triangulate_linear
from sfmcpp.map import LocalProblem
from sfmcpp.model.names import Loss
from sfmcpp.slam.fusing import constraint_groups
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.stereo import with_right_views
from sfmcpp.slam.world_map import WorldMap
from sfmcpp.weighting import solve

# Oldest keyframes of a window that stay, so that no similarity moves it. The same with sensors and without:
# with one alone the scale would be left to odometers, and to drift where they have no weight.
HELD_KEYFRAMES = 2
# Matches of left and right that are wrong are gross, and many where a texture repeats: on KITTI's 0001 a
# third of the first disparities is off by some 30 %. With Huber's loss they bend the scale.
_LOSS: tuple[Loss, float] = ("huber", 2.0)
_STEREO_LOSS: tuple[Loss, float] = ("cauchy", 1.0)


def triangulate_new(world: WorldMap, settings: SlamSettings) -> int:
    """Give points to the tracks that recent keyframes see; how many."""
    local = world.triangulation(settings.triangulation_keyframes)
    if not local.problem.num_points:
        return 0
    problem = with_right_views(world, local).problem
    points = triangulate_linear(problem)
    points = refine_points(problem, points, max_steps=5)
    good = reliable_points(
        problem, points, max_error_px=settings.outlier_px, min_angle_deg=settings.min_angle_deg
    )
    world.points[local.points[good]] = points[good]
    return int(np.count_nonzero(good))


def adjust(world: WorldMap, settings: SlamSettings) -> Summary | None:
    """Adjust the last keyframes and their points, then drop the outliers (thesis §5.2.4)."""
    local = world.around(settings.window)
    if local.problem.num_observations < 3 * settings.min_inliers:
        return None
    groups = constraint_groups(world, local)
    hold_gauge(local, 1 if world.stereo else HELD_KEYFRAMES)
    both = with_right_views(world, local)
    loss, scale_px = _STEREO_LOSS if world.stereo else _LOSS
    summary = solve(
        both.problem,
        constraints=[*groups, *both.rigid],
        threads=1,
        loss=loss,
        loss_scale_px=scale_px,
        max_iterations=10,
        function_tolerance=1e-4,
    ).require_uninterrupted()
    both.take()
    drop_outliers(world, local, settings)
    return summary


def hold_gauge(local: LocalProblem, count: int) -> None:
    """Fix `count` cameras, the oldest that see points."""
    problem = local.problem
    sees = np.bincount(problem.camera_index, minlength=problem.num_cameras) > 0
    missing = count - np.count_nonzero(problem.fixed_cameras & sees)
    free = np.flatnonzero(~problem.fixed_cameras & sees)
    problem.fixed_cameras[free[: max(missing, 0)]] = True


def drop_outliers(world: WorldMap, local: LocalProblem, settings: SlamSettings) -> None:
    """Forget observations with errors above `outlier_px`, and points with too few views left."""
    both = with_right_views(world, local)
    errors = reprojection_errors_px(both.problem, both.problem.points)
    both.drop(errors > settings.outlier_px, settings.min_views)
