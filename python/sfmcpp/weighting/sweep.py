"""Fits of one pose over a grid of weights, or at given weights."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp import _core
from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, BoolArray, FloatArray, IndexArray, finite_array
from sfmcpp.model.checks import require_count
from sfmcpp.weighting.pose_inputs import PoseConstraint, PoseView

# Reprojection error of an inlier (thesis §5.2.3.2).
INLIER_PX = 2.0
# Steps of the fit without one observation.
_FOLD_ITERATIONS = 3

WeightedConstraint = tuple[PoseConstraint, float]


@dataclass(frozen=True)
class WeightSweep:
    """The optima over W weights of one constraint.

    Attributes
    ----------
    weights : (W,) float64
        The weights λ.
    poses : (W, 3, 4) float64
        The optima, world_from_camera.
    vision : (W,) float64
        Mean squared reprojection error, in units of sigma_px².
    held : (W,) float64
        Σ λ² ε of the constraints that keep their weight.
    constraint : (W,) float64
        Mean squared error ε of the selected constraint.
    constraint_slope : (W,) float64
        dε / d log λ along the optima, with the Gauss–Newton Hessian.
    leave_one_out, approximate_leave_one_out : (W,) float64
        Scores of cross-validation, in units of sigma_px²; empty if not asked for.
    inliers : (W,) int32
        Points in front of the camera and within `INLIER_PX`.
    converged : (W,) bool
        Whether the fit came to its minimum.
    """

    weights: FloatArray
    poses: FloatArray
    vision: FloatArray
    held: FloatArray
    constraint: FloatArray
    constraint_slope: FloatArray
    leave_one_out: FloatArray
    approximate_leave_one_out: FloatArray
    inliers: IndexArray
    converged: BoolArray


@dataclass(frozen=True)
class PoseFit:
    """A pose fitted at given weights.

    Attributes
    ----------
    pose : (3, 4) float64
        The optimum, world_from_camera.
    vision : float
        Mean squared reprojection error, in units of sigma_px².
    constraints : (k,) float64
        Mean squared error of each constraint.
    converged : bool
        Whether the fit came to its minimum.
    """

    pose: FloatArray
    vision: float
    constraints: FloatArray
    converged: bool


@checked()
def sweep_weights(
    view: PoseView,
    constraint: PoseConstraint,
    weights: ArrayLike,
    start: ArrayLike,
    *,
    held: Sequence[WeightedConstraint] = (),
    leave_one_out: bool = False,
    approximate_leave_one_out: bool = False,
    threads: int = 1,
) -> WeightSweep:
    """Fit the pose for each weight of a constraint, each from the optimum of the weight before.

    The cost is ``mean ‖reprojection error / σ‖² + λ² ε + Σ λ_k² ε_k`` (thesis eq. 5.1).

    Parameters
    ----------
    view : PoseView
        What the camera sees.
    constraint : PoseConstraint
        The constraint whose weight varies.
    weights : (W,) float64
        Its weights, not negative, best in increasing order.
    start : (3, 4) float64
        Pose from which the first fit starts, world_from_camera.
    held : sequence of (PoseConstraint, float)
        Further constraints, each with the weight it keeps.
    leave_one_out, approximate_leave_one_out : bool
        Which scores of cross-validation to compute (thesis eqs 5.8–5.9; closed form).
    threads : int
        Of the exact scores; 0: as many as the machine has and they are worth. Same bits for any.

    Returns
    -------
    WeightSweep
        The optima and what there is to know of them.

    Raises
    ------
    InvalidArgument
        If an argument has the wrong shape, a pose no rotation, a number is out of its range, or there are
        fewer than 4 observations.
    """
    grid = finite_array("weights", weights, (ANY,))
    options = _core.PoseSweepOptions()
    options.inlier_px, options.fold_iterations = INLIER_PX, _FOLD_ITERATIONS
    options.leave_one_out, options.approximate_leave_one_out = leave_one_out, approximate_leave_one_out
    options.threads = threads
    arrays = [constraint.arrays(0.0), *(other.arrays(weight) for other, weight in held)]
    pose = finite_array("start", start, (3, 4))
    found: dict[str, Any] = _core.sweep_pose_weights(view.arrays(), arrays, 0, grid.tolist(), pose, options)
    found["converged"] = found["converged"].astype(np.bool_)
    return WeightSweep(weights=grid, **found)


@checked()
def refine_pose(view: PoseView, constraints: Sequence[WeightedConstraint], start: ArrayLike) -> PoseFit:
    """Fit the pose with every constraint at its weight (thesis eq. 5.7).

    Parameters
    ----------
    view : PoseView
        What the camera sees.
    constraints : sequence of (PoseConstraint, float)
        Each constraint with its weight λ.
    start : (3, 4) float64
        Pose from which the fit starts, world_from_camera.

    Returns
    -------
    PoseFit
        The optimum and its errors.

    Raises
    ------
    InvalidArgument
        As :func:`sweep_weights`.
    """
    arrays = [constraint.arrays(weight) for constraint, weight in constraints]
    pose = finite_array("start", start, (3, 4))
    return PoseFit(**_core.refine_pose(view.arrays(), arrays, pose, _core.PoseSweepOptions()))


@checked()
def weight_grid(count: int = 100, smallest: float = 1e-3, largest: float = 1e3) -> FloatArray:
    """Zero and log-spaced weights (thesis eq. 5.6, with both ends included).

    Parameters
    ----------
    count : int
        Number of weights, zero included; at least 3.
    smallest, largest : float
        Ends of the positive weights.

    Returns
    -------
    (count,) float64
        Increasing weights, the first of them zero.

    Raises
    ------
    InvalidArgument
        If `count` is too small or the ends are not positive, finite and in order.
    """
    require_count("count", count, at_least=3)
    if not 0 < smallest < largest < np.inf:
        raise InvalidArgument(f"smallest = {smallest}, largest = {largest}: must be positive and in order")
    return np.concatenate([[0.0], np.geomspace(smallest, largest, count - 1)])
