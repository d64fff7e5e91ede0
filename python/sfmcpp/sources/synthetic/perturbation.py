"""Noisy starts: a problem moved away from its present state."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry import so3
from sfmcpp.model import Problem
from sfmcpp.model.checks import require_not_negative

# A stream of its own: with a scene's stream, equal seeds would tie the noise to the positions of the points.
_STREAM = (1,)


def perturb(
    problem: Problem,
    *,
    point_sigma_m: float = 0.0,
    position_sigma_m: float = 0.0,
    rotation_sigma_deg: float = 0.0,
    seed: int,
) -> Problem:
    """Copy `problem` with Gaussian noise on its points and poses (thesis §4.4.1.3).

    Fixed points and fixed cameras stay where they are. The same seed gives the same directions at every
    noise level, and each of the three kinds of noise is independent of the levels of the others.

    Parameters
    ----------
    problem : Problem
        Left untouched.
    point_sigma_m : float
        Standard deviation of each coordinate of the points [m].
    position_sigma_m : float
        Standard deviation of each coordinate of the camera centres [m].
    rotation_sigma_deg : float
        Standard deviation of each component of the rotation vector w in ``R ← R exp([w]×)`` [deg].
    seed : int
        Seed of the noise.

    Raises
    ------
    InvalidArgument
        If a standard deviation is negative or not finite.
    """
    require_not_negative("point_sigma_m", point_sigma_m)
    require_not_negative("position_sigma_m", position_sigma_m)
    require_not_negative("rotation_sigma_deg", rotation_sigma_deg)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=_STREAM))
    cameras = problem.num_cameras
    point_steps = point_sigma_m * rng.standard_normal((problem.num_points, 3))
    position_steps = position_sigma_m * rng.standard_normal((cameras, 3))
    rotation_steps_rad = np.deg2rad(rotation_sigma_deg) * rng.standard_normal((cameras, 3))

    result = problem.copy()
    free_points, free_cameras = ~problem.fixed_points, ~problem.fixed_cameras
    result.points[free_points] += point_steps[free_points]
    result.centres[free_cameras] += position_steps[free_cameras]
    result.rotations[free_cameras] = (problem.rotations @ so3.exp(rotation_steps_rad))[free_cameras]
    return result
