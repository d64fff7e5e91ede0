"""Disturbances of a problem: hidden observations, outliers, perturbed initial states."""

from __future__ import annotations

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_not_negative, require_one_of, require_positive, require_share
from sfmcpp.model.selection import remade
from sfmcpp.sources.synthetic.observation import keep_points_seen_twice

# Streams of their own: with that of a scene, equal seeds would tie the noise to the positions of the points.
_PERTURBED, _OUTLIERS = (1,), (2,)
PATTERNS = ("scattered", "runs")
# Streams of their own, as those of noise and outliers.
_MISSING = (3,)


@checked()
def add_outliers(
    problem: Problem, share: float, *, sigma_px: float | None = None, seed: int
) -> tuple[Problem, BoolArray]:
    """Copy `problem` with a share of its observations replaced by wrong ones.

    Parameters
    ----------
    problem : Problem
        Left untouched.
    share : float
        Share of the observations to replace, between 0 and 1; rounded to a whole number of them.
    sigma_px : float, optional
        Standard deviation of the errors added to each coordinate [px]; some errors are small. Default:
        observations are replaced by uniformly distributed positions in the image.
    seed : int
        Same seed, same outliers; a larger share keeps those of a smaller one.

    Returns
    -------
    problem : Problem
        The copy.
    is_outlier : (M,) bool
        Which observations were replaced.

    Raises
    ------
    InvalidArgument
        If `share` is not between 0 and 1, `sigma_px` is not positive, or the sizes of the images are needed
        and unknown.
    """
    problem = remade(problem)
    require_share("share", share)
    if sigma_px is not None:
        require_positive("sigma_px", sigma_px)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=_OUTLIERS))
    chosen = rng.permutation(problem.num_observations)[: round(share * problem.num_observations)]
    if sigma_px is None:
        wrong = _anywhere_in_image(problem, rng)
    else:
        wrong = problem.pixels + sigma_px * rng.standard_normal(problem.pixels.shape)
    result = problem.copy()
    result.pixels[chosen] = wrong[chosen]
    is_outlier = np.zeros(problem.num_observations, dtype=np.bool_)
    is_outlier[chosen] = True
    return result, is_outlier


def _anywhere_in_image(problem: Problem, rng: np.random.Generator) -> FloatArray:
    """(M, 2) a place in the image of each observation."""
    sizes = problem.metadata.image_sizes
    if sizes is None:
        raise InvalidArgument("sigma_px = None: must be given where the problem knows no image sizes")
    # Pixels of BAL's model are counted from the image centre.
    first_corner = -0.5 if problem.camera_model == "bal" else 0.0
    shares = first_corner + rng.uniform(size=problem.pixels.shape)
    places: FloatArray = shares * sizes[problem.camera_index]
    return places


@checked()
def perturb(
    problem: Problem,
    *,
    point_sigma_m: float = 0.0,
    position_sigma_m: float = 0.0,
    rotation_sigma_deg: float = 0.0,
    focal_sigma: float = 0.0,
    seed: int,
) -> Problem:
    """Copy `problem` with Gaussian noise on its points, poses (thesis §4.4.1.3) and focal lengths.

    Fixed cameras and points do not change; rigid cameras move with their frames. The same seed gives the same
    directions at every noise level, and each kind of noise is independent of the levels of the others.

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
    focal_sigma : float
        Standard deviation of the logarithm of the free focal lengths.
    seed : int
        Seed of the noise.

    Raises
    ------
    InvalidArgument
        If a standard deviation is negative or not finite, or the cameras are projective and have no poses.
    """
    problem = remade(problem)
    if not problem.is_metric:
        raise InvalidArgument("problem: projective cameras have no poses; perturb it before as_projective")
    require_not_negative("point_sigma_m", point_sigma_m)
    require_not_negative("position_sigma_m", position_sigma_m)
    require_not_negative("rotation_sigma_deg", rotation_sigma_deg)
    require_not_negative("focal_sigma", focal_sigma)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=_PERTURBED))
    cameras = problem.num_cameras
    point_steps = point_sigma_m * rng.standard_normal((problem.num_points, 3))
    position_steps = position_sigma_m * rng.standard_normal((cameras, 3))
    rotation_steps_rad = np.deg2rad(rotation_sigma_deg) * rng.standard_normal((cameras, 3))

    result = problem.copy()
    free_points, free_cameras = ~problem.fixed_points, ~problem.fixed_cameras
    result.points[free_points] += point_steps[free_points]
    if position_sigma_m > 0 or rotation_sigma_deg > 0:
        moved = _moved_cameras(problem, position_steps, so3.exp(rotation_steps_rad))
        result.cameras[free_cameras] = moved[free_cameras]
    if focal_sigma > 0 and "f" in problem.intrinsic_names:
        column = problem.intrinsic_names.index("f")
        free_focals = ~problem.fixed_intrinsics[:, column]
        zoom = np.exp(focal_sigma * rng.standard_normal(len(free_focals)))
        result.intrinsics[free_focals, column] *= zoom[free_focals]
    return result


def _moved_cameras(problem: Problem, steps: FloatArray, turns: FloatArray) -> FloatArray:
    """(C, 3, 4) cameras moved by `steps` (C, 3) and `turns` (C, 3, 3); of rigs, their frames moved so."""
    poses = problem.cameras if problem.rigs is None else problem.rigs.frames(problem.cameras)
    moved = np.concatenate(
        [poses[:, :, :3] @ turns[: len(poses)], poses[:, :, 3:] + steps[: len(poses), :, None]], axis=2
    )
    return moved if problem.rigs is None else problem.rigs.cameras(moved)


@checked()
def hide_observations(problem: Problem, share: float, *, pattern: str = "runs", seed: int) -> Problem:
    """Copy `problem` without a share of the observations it would have if every camera saw every point.

    Parameters
    ----------
    problem : Problem
        Left untouched.
    share : float
        Share of all pairs of a camera and a point, between 0 and 1; pairs without an observation in
        `problem` are ignored.
    pattern : str
        ``"scattered"``: every pair with this probability. ``"runs"``: each point is seen by consecutive
        cameras (cyclically), as if occluded by the object elsewhere.
    seed : int
        Same seed, same observations.

    Returns
    -------
    Problem
        Points that fewer than two cameras see are dropped too; all else is as in `problem`.

    Raises
    ------
    InvalidArgument
        If `share` is not between 0 and 1, the pattern is unknown, or no point is left.
    """
    require_share("share", share)
    require_one_of("pattern", pattern, PATTERNS)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=_MISSING))
    if pattern == "scattered":
        seen = rng.uniform(size=problem.num_observations) >= share
    else:
        seen = _seen_in_runs(problem, round((1 - share) * problem.num_cameras), rng)
    return keep_points_seen_twice(problem.with_observations(seen))


def _seen_in_runs(problem: Problem, length: int, rng: np.random.Generator) -> BoolArray:
    count = max(problem.num_cameras, 1)
    first = rng.integers(0, count, problem.num_points)
    since = (problem.camera_index - first[problem.point_index]) % count
    return np.asarray(since < length)
