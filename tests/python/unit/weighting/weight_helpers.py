"""Small scenes with sensors of known noise, and their linear model as dense matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import sfmcpp
from sfmcpp import ConstraintGroup, Problem
from sfmcpp.ba.options import SolveOptions
from sfmcpp.weighting import WeightSelection
from sfmcpp.weighting.fits import WeightFit, WeightFits

Array = NDArray[np.float64]


def small_scene(seed: int = 0) -> tuple[Problem, Problem]:
    """A start and the truth: 6 cameras round 25 points."""
    truth = sfmcpp.circle_scene(6, 25, pixel_sigma_px=0.5, seed=seed)
    return _moved(truth, seed), truth


def street(seed: int = 0, cameras: int = 40) -> tuple[Problem, Problem]:
    """A start and the truth: a street whose images drift."""
    truth = sfmcpp.street_loop_scene(cameras, 700, pixel_sigma_px=1.0, seed=seed)
    return _moved(truth, seed), truth


def _moved(truth: Problem, seed: int) -> Problem:
    return sfmcpp.perturb(
        truth, point_sigma_m=0.05, position_sigma_m=0.05, rotation_sigma_deg=0.3, seed=seed + 100
    )


def gps(truth: Problem, sigma_m: float, seed: int = 0, **more: Any) -> ConstraintGroup:
    noise = np.random.default_rng([seed, 7]).normal(0, sigma_m, (truth.num_cameras, 3))
    return ConstraintGroup(
        "position", np.arange(truth.num_cameras), truth.centres + noise, name="gps", **more
    )


def odometer(truth: Problem, sigma_m: float, seed: int = 0, **more: Any) -> ConstraintGroup:
    count = truth.num_cameras - 1
    pairs = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    noise = np.random.default_rng([seed, 8]).normal(0, sigma_m, count)
    steps = np.linalg.norm(np.diff(truth.centres, axis=0), axis=1)
    return ConstraintGroup("scale", pairs, steps + noise, name="odometer", **more)


def fitted(
    problem: Problem, groups: list[ConstraintGroup], weights: Array, **options: Any
) -> tuple[WeightFits, WeightFit]:
    """The optimum at given weights, sharp."""
    fits = WeightFits(problem, groups, SolveOptions(function_tolerance=1e-14, **options))
    fit = fits.fit(weights, fits.alone.problem)
    return fits, fits.fit(weights, fit.problem)


def dense_jacobian(problem: Problem) -> Array:
    """(2M, n + 3N): all columns of cameras, then all points."""
    return np.asarray(sfmcpp.linearize(problem).jacobian().toarray())


def dense_rows(group: ConstraintGroup, problem: Problem) -> tuple[Array, Array]:
    """Errors of a group and their Jacobian over the columns of :func:`dense_jacobian`."""
    model = sfmcpp.linearize(problem, constraints=[group])
    (rows,) = model.groups
    missing = model.num_columns - model.num_camera_columns
    return rows.errors, np.pad(rows.jacobian().toarray(), ((0, 0), (0, missing)))


def is_recovered(chosen: WeightSelection, sigma: float) -> bool:
    """Within three standard errors of a standard deviation from that many numbers, and at most half off."""
    assert chosen.redundancy is not None
    return abs(np.log(chosen.sensor_sigma / sigma)) < min(3 / np.sqrt(2 * chosen.redundancy), np.log(2))
