"""New points, the local adjustment of the last keyframes and the final one of all, and outliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sfmcpp.ba import Summary
from sfmcpp.geometry import refine_points, reliable_points, reprojection_errors_px, triangulate_linear
from sfmcpp.map import LocalProblem
from sfmcpp.model import ConstraintGroup, Problem
from sfmcpp.model.names import Loss
from sfmcpp.model.selection import observing_cameras
from sfmcpp.sensors.registration import OPEN_ROLL_RAD
from sfmcpp.slam.fusion import constraint_groups
from sfmcpp.slam.measurement import METRIC_KINDS, PLACE_KINDS
from sfmcpp.slam.result import FinalAdjustment, SlamResult
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.stereo import RIGID, with_right_views
from sfmcpp.slam.world_map import WorldMap
from sfmcpp.weighting import solve

# So many keyframes of a window are held, the oldest, so that no similarity moves it. The same with sensors
# and without: with one alone the scale would depend on odometers, and drift where they have no weight.
HELD_KEYFRAMES = 2
# Loss of the images and its scale [px], in local adjustments …
LOCAL_LOSS: tuple[Loss, float] = ("huber", 2.0)
# … and where errors are gross: what local adjustments have left, and right images, whose wrong matches bend
# the scale with Huber's loss (on KITTI's 0001 a third of the first disparities is off by some 30 %).
ROBUST_LOSS: tuple[Loss, float] = ("cauchy", 1.0)
# First damping λ of local adjustments, and no bent steps: settings of SLAM were chosen with these. From the
# default, a tenth of it, what few points hold moves further: nothing is gained on drives for tuning, and one
# other went astray.
_FIRST_DAMPING = 1e-4
# Further digits of the final cost depend on directions that hardly any image determines.
_TOLERANCE = 1e-5
# Name of the group that holds the orientations where positions leave them open.
_PRIOR_NAME = "as left"


def triangulate_new(world: WorldMap, settings: SlamSettings) -> int:
    """Triangulate the tracks without a point that recent keyframes see; the number of new points."""
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
    summary = solve_live(both.problem, [*groups, *both.rigid], ROBUST_LOSS if world.stereo else LOCAL_LOSS)
    both.take()
    drop_outliers(world, local, settings)
    return summary


def solve_live(problem: Problem, constraints: Sequence[ConstraintGroup], loss: tuple[Loss, float]) -> Summary:
    """Adjust a problem as far as it is worth between two frames: ten steps, or four digits of the cost.

    `loss` is that of the images and its scale [px].
    """
    name, scale_px = loss
    return solve(
        problem,
        constraints=constraints,
        threads=1,
        loss=name,
        loss_scale_px=scale_px,
        max_iterations=10,
        function_tolerance=1e-4,
        initial_damping=_FIRST_DAMPING,
        acceleration="none",
    ).require_uninterrupted()


def hold_gauge(local: LocalProblem, count: int) -> None:
    """Fix `count` cameras, the oldest that see points."""
    problem = local.problem
    sees = observing_cameras(problem)
    missing = count - np.count_nonzero(problem.fixed_cameras & sees)
    free = np.flatnonzero(~problem.fixed_cameras & sees)
    problem.fixed_cameras[free[: max(missing, 0)]] = True


def drop_outliers(world: WorldMap, local: LocalProblem, settings: SlamSettings) -> None:
    """Forget observations with errors above `outlier_px`, and points with too few views left."""
    both = with_right_views(world, local)
    errors = reprojection_errors_px(both.problem, both.problem.points)
    both.drop(errors > settings.outlier_px, settings.min_views)


def finish_map(result: SlamResult, settings: SlamSettings) -> None:
    """Adjust all keyframes and points of a run together with its sensors, and keep it if that is a gain.

    Parameters
    ----------
    result : SlamResult
        The run; its map and the frames between keyframes move, and `final` has the costs.
    settings : SlamSettings
        `final_adjustment` decides whether it is kept always, or if images and all sensors gain.
    """
    world = result.world
    if settings.final_adjustment == "off" or world is None:
        return
    local = world.whole_problem(settings.min_views)
    loss, scale_px = ROBUST_LOSS
    groups = [replace(group, loss=loss) for group in constraint_groups(world, local)]
    # Without sensors the images always gain, but on drives the errors of their poses did not.
    if settings.final_adjustment == "auto" and not groups:
        return
    placed = any(group.kind in PLACE_KINDS for group in groups)
    scaled = any(group.kind in METRIC_KINDS for group in groups)
    hold_gauge(local, 0 if placed else 1 if scaled or world.stereo else HELD_KEYFRAMES)
    held = [_orientation_prior(local.problem)] if placed else []
    both = with_right_views(world, local)
    summary = solve(
        both.problem,
        constraints=[*groups, *held, *both.rigid],
        loss=loss,
        loss_scale_px=scale_px,
        function_tolerance=_TOLERANCE,
        max_iterations=50,
    ).require_uninterrupted()
    done = _final_adjustment_of(summary)
    result.final = replace(done, kept=done.improved or settings.final_adjustment == "on")
    if result.final.kept:
        before = world.poses.copy()
        both.take()
        drop_outliers(world, local, settings)
        result.path.follow(before)


def _orientation_prior(problem: Problem) -> ConstraintGroup:
    """Hold the orientations of all cameras, so loosely that it only matters where positions leave them open.

    Positions on a straight line do not determine the roll of a part of the map that shares no point with the
    others; it would follow their noise. The whole map is held to `OPEN_ROLL_RAD`, beyond which registration
    counts a roll as open.
    """
    count = problem.num_cameras
    sigma = OPEN_ROLL_RAD * np.sqrt(count)
    return ConstraintGroup(
        "orientation", np.arange(count, dtype=np.int32), problem.rotations, sigma=sigma, name=_PRIOR_NAME
    )


def _final_adjustment_of(summary: Summary) -> FinalAdjustment:
    sensors = {name: (float(a), float(b)) for name, (a, b) in summary.constraint_costs.items()}
    sums = np.array(list(sensors.values())).reshape(-1, 2).sum(axis=0)
    pixels = (float(summary.initial_cost - sums[0]), float(summary.final_cost - sums[1]))
    for name in (RIGID, _PRIOR_NAME):
        sensors.pop(name, None)
    return FinalAdjustment(False, pixels, sensors)
