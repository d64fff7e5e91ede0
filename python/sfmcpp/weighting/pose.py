"""Weights λ of sensor constraints, selected from the data of one pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, BoolArray, FloatArray, finite_array
from sfmcpp.model.checks import require_count, require_not_negative, require_one_of, require_positive
from sfmcpp.model.weight_selection import WeightSelection
from sfmcpp.weighting.bounds import WEIGHT_BOUNDS, declared_bounds
from sfmcpp.weighting.conflict import conflict
from sfmcpp.weighting.criteria import admissible_weights, running_median
from sfmcpp.weighting.methods import ROUNDS, WeightMethod, selection_method
from sfmcpp.weighting.pose_inputs import PoseConstraint, PoseView
from sfmcpp.weighting.sweep import WeightedConstraint, WeightSweep, refine_pose, sweep_weights, weight_grid
from sfmcpp.weighting.units import sigma_of_weight

# Cheaper methods for all rounds but the last, in which weights are only what the others are chosen beside.
_EARLY_METHODS = {"loo": "loo-approx"}


@checked()
def equivalent_sigma(constraint: PoseConstraint, weight: float, count: int, pixel_sigma: float) -> float:
    """Standard deviation of a sensor that a weight λ amounts to: ``σ_px √(spread / n) / λ``.

    Parameters
    ----------
    constraint : PoseConstraint
        The constraint.
    weight : float
        Its weight λ.
    count : int
        Number n of observations.
    pixel_sigma : float
        Standard deviation of the images, in the units of their errors.

    Returns
    -------
    float
        Standard deviation of each component, in the constraint's unit; infinite for λ = 0.

    Raises
    ------
    InvalidArgument
        If a number is not finite, `weight` is negative, or another one is not positive.
    """
    require_not_negative("weight", weight)
    require_count("count", count)
    require_positive("pixel_sigma", pixel_sigma)
    return sigma_of_weight(constraint.unit, count * weight * weight, pixel_sigma)


@checked()
def select_weight(
    view: PoseView,
    constraint: PoseConstraint,
    start: ArrayLike,
    method: str = "loo",
    *,
    weights: ArrayLike | None = None,
    held: Sequence[WeightedConstraint] = (),
    bounds: str = "none",
    threads: int = 1,
) -> WeightSelection:
    """Choose the weight of one constraint (thesis §5.2.3).

    Parameters
    ----------
    view : PoseView
        What the camera sees: the inliers of the pose, on points that are known already.
    constraint : PoseConstraint
        What the sensor says.
    start : (3, 4) float64
        Pose from which fits start, world_from_camera: that of the images alone.
    method : str
        ``"loo"``, ``"loo-approx"``, ``"l-curve"``, ``"l-curve-scaled"``, ``"ltn"``, ``"fixed:λ"`` or
        ``"none"``.
    weights : (W,) float64, optional
        Weights to try, increasing, the first zero; None: :func:`weight_grid`. Not read by ``"fixed:λ"`` and
        ``"none"``.
    held : sequence of (PoseConstraint, float)
        Further constraints, each with the weight it keeps.
    bounds : {"none", "declared"}
        Between which weights to choose: any, as in the thesis, or at most that of the declared σ and at least
        what a conflict leaves of it (:func:`declared_bounds`), whatever it does to the inliers. The second
        makes its own weights to try, and is not for ``"fixed:λ"`` and ``"none"``.
    threads : int
        Of exact cross-validation; 0: as many as the machine has and it is worth. Same bits for any.

    Returns
    -------
    WeightSelection
        The weight, the curve, the standard deviation it amounts to and the conflict report.

    Raises
    ------
    InvalidArgument
        If the method is unknown or an argument breaks a rule; there must be at least 4 observations.
    """
    require_one_of("bounds", bounds, WEIGHT_BOUNDS)
    images = _image_term(view, start, bounds, threads)
    return _select_one(images, constraint, selection_method(method), weights, held)


@checked()
def select_weights(
    view: PoseView,
    constraints: Sequence[PoseConstraint],
    start: ArrayLike,
    method: str | Sequence[str] = "loo",
    *,
    weights: ArrayLike | None = None,
    bounds: str = "none",
    threads: int = 1,
) -> list[WeightSelection]:
    """Choose the weights of several constraints, one after the other, twice round.

    Beyond the thesis, coordinate-wise: all start at zero; each is chosen with the others held at what they
    have, in the first round by the closed form where cross-validation is asked for. Sensors of different
    directions do not notice each other; of two that say the same, the first takes what it needs and the
    second what is left. The poses of the result are fitted at all final weights.

    Parameters
    ----------
    view : PoseView
        What the camera sees.
    constraints : sequence of PoseConstraint
        What each sensor says.
    start : (3, 4) float64
        Pose from which fits start, world_from_camera.
    method : str or sequence of str
        One of those of :func:`select_weight`, for all or for each.
    weights : (W,) float64, optional
        Weights to try, increasing, the first zero; None: :func:`weight_grid`.
    bounds : {"none", "declared"}
        As in :func:`select_weight`, for all.
    threads : int
        Of exact cross-validation; 0: as many as the machine has and it is worth. Same bits for any.

    Returns
    -------
    list of WeightSelection
        One for each constraint, in their order; its curve is that of the last round.

    Raises
    ------
    InvalidArgument
        As :func:`select_weight`, or if methods and constraints differ in number.
    """
    require_one_of("bounds", bounds, WEIGHT_BOUNDS)
    methods = [method] * len(constraints) if isinstance(method, str) else list(method)
    if len(methods) != len(constraints):
        raise InvalidArgument(
            f"method: {len(methods)}, must be one for each of {len(constraints)} constraints"
        )
    exact = [selection_method(m) for m in methods]
    early = [selection_method(_EARLY_METHODS.get(m, m)) for m in methods]
    rounds = [early] * (ROUNDS - 1) if len(constraints) > 1 else []
    images = _image_term(view, start, bounds, threads)
    chosen = np.zeros(len(constraints))
    selections: list[WeightSelection] = []
    for parsed in [*rounds, exact]:
        selections = []
        for k, constraint in enumerate(constraints):
            others = [(c, w) for j, (c, w) in enumerate(zip(constraints, chosen, strict=True)) if j != k]
            selections.append(_select_one(images, constraint, parsed[k], weights, others))
            chosen[k] = selections[-1].weight
    final = refine_pose(view, list(zip(constraints, chosen, strict=True)), images.pose).pose
    return [replace(selection, pose=final) for selection in selections]


@dataclass(frozen=True)
class _Images:
    """The images of one pose, and how its weights are chosen.

    Attributes
    ----------
    view : PoseView
        Observations of the camera.
    pose : (3, 4) float64
        Optimum of the images alone, world_from_camera.
    sigma : float
        Standard deviation of the images there, in units of the declared one.
    bounds : str
        One of `WEIGHT_BOUNDS`.
    threads : int
        Of exact cross-validation.
    """

    view: PoseView
    pose: FloatArray
    sigma: float
    bounds: str
    threads: int


def _image_term(view: PoseView, start: ArrayLike, bounds: str, threads: int) -> _Images:
    pose = refine_pose(view, [], start).pose
    # Once more from there, as every sweep begins.
    sigma = view.pixel_sigma(refine_pose(view, [], pose).vision)
    return _Images(view, pose, sigma, bounds, threads)


def _select_one(
    images: _Images,
    constraint: PoseConstraint,
    method: WeightMethod,
    weights: ArrayLike | None,
    held: Sequence[WeightedConstraint],
) -> WeightSelection:
    report = conflict(images.view, constraint, images.pose)
    bounds = None
    if images.bounds == "declared" and method.grid is None:
        bounds = declared_bounds(constraint, images.view.count, images.sigma, report)
    grid = _checked_grid(weights, method) if bounds is None else bounds.grid()
    sweep = sweep_weights(
        images.view,
        constraint,
        grid,
        images.pose,
        held=held,
        leave_one_out=method.name == "loo",
        approximate_leave_one_out=method.name == "loo-approx",
        threads=images.threads,
    )
    score = _scores_of_sweep(method, sweep)
    admissible = bounds.hold(grid) if bounds else _with_enough_inliers(images, constraint, sweep, held)
    index = method.choose(score, admissible)
    if bounds and not admissible[index]:  # no score is finite within the bounds
        index = int(np.flatnonzero(admissible)[0])
    weight = float(grid[index])
    return WeightSelection(
        name=constraint.name,
        method=method.name,
        weight=weight,
        weights=grid,
        vision=sweep.vision,
        constraint_error=sweep.constraint,
        score=score,
        admissible=admissible,
        sensor_sigma=equivalent_sigma(constraint, weight, images.view.count, images.sigma),
        unit=constraint.unit.name,
        conflict=report,
        pose=sweep.poses[index],
    )


def _with_enough_inliers(
    images: _Images, constraint: PoseConstraint, sweep: WeightSweep, held: Sequence[WeightedConstraint]
) -> BoolArray:
    """Which weights (W,) of a sweep that begins at zero keep enough inliers of the images alone."""
    alone = sweep if not held else sweep_weights(images.view, constraint, [0.0], images.pose)
    return admissible_weights(sweep.inliers, int(alone.inliers[0]))


def _scores_of_sweep(method: WeightMethod, sweep: WeightSweep) -> FloatArray:
    if method.trade_off is not None:
        rest = sweep.vision + sweep.held
        return running_median(method.trade_off(sweep.weights, rest, sweep.constraint, sweep.constraint_slope))
    measured = {"loo": sweep.leave_one_out, "loo-approx": sweep.approximate_leave_one_out}
    return measured.get(method.name, np.zeros_like(sweep.weights))


def _checked_grid(weights: ArrayLike | None, method: WeightMethod) -> FloatArray:
    if method.grid is not None:
        return method.grid
    if weights is None:
        return weight_grid()
    grid = finite_array("weights", weights, (ANY,))
    if len(grid) < 2 or grid[0] != 0 or not (np.diff(grid) > 0).all():
        raise InvalidArgument("weights: must begin with zero and increase strictly, at least two")
    return grid
