"""New points, the local adjustment, and what it shows to be wrong."""

from __future__ import annotations

import numpy as np

from sfmcpp.ba import Summary
from sfmcpp.geometry import refine_points, reliable_points, reprojection_errors_px, triangulate_linear
from sfmcpp.map import LocalProblem
from sfmcpp.slam.fusing import constraint_groups
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import WorldMap
from sfmcpp.weighting import solve

# Oldest keyframes of a window that stay, so that no similarity moves it. The same with sensors and without:
# with one alone the scale would be left to odometers, and to drift where they have no weight.
HELD_KEYFRAMES = 2


def triangulate_new(world: WorldMap, settings: SlamSettings) -> int:
    """Give points to the tracks that recent keyframes see; how many."""
    local = world.triangulation(settings.triangulation_keyframes)
    if not local.problem.num_points:
        return 0
    points = triangulate_linear(local.problem)
    points = refine_points(local.problem, points, max_steps=5)
    good = reliable_points(
        local.problem, points, max_error_px=settings.outlier_px, min_angle_deg=settings.min_angle_deg
    )
    world.points[local.points[good]] = points[good]
    return int(np.count_nonzero(good))


def adjust(world: WorldMap, settings: SlamSettings) -> Summary | None:
    """Adjust the last keyframes and their points, then drop the outliers (thesis §5.2.4)."""
    local = world.around(settings.window)
    if local.problem.num_observations < 3 * settings.min_inliers:
        return None
    groups = constraint_groups(world, local)
    hold_gauge(local, HELD_KEYFRAMES)
    summary = solve(
        local.problem,
        constraints=groups,
        threads=1,
        loss="huber",
        loss_scale_px=2.0,
        max_iterations=10,
        function_tolerance=1e-4,
    ).require_uninterrupted()
    world.take(local)
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
    errors = reprojection_errors_px(local.problem, local.problem.points)
    world.drop(local, errors > settings.outlier_px, settings.min_views)
