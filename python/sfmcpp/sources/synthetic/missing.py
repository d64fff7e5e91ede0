"""Observations taken away: tracks that are not seen everywhere."""

from __future__ import annotations

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray
from sfmcpp.model.checks import require_one_of, require_share
from sfmcpp.sources.synthetic.observation import keep_points_seen_twice

PATTERNS = ("scattered", "runs")
# Streams of their own, as those of noise and outliers.
_MISSING = (3,)


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
        Points that fewer than two cameras see are dropped too.

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
        seen = _in_runs(problem, round((1 - share) * problem.num_cameras), rng)
    return keep_points_seen_twice(
        Problem(
            problem.camera_model,
            problem.cameras.copy(),
            problem.intrinsics.copy(),
            problem.points.copy(),
            problem.camera_index[seen],
            problem.point_index[seen],
            problem.pixels[seen],
            intrinsics_index=problem.intrinsics_index.copy(),
            metadata=problem.metadata,
        )
    )


def _in_runs(problem: Problem, length: int, rng: np.random.Generator) -> BoolArray:
    first = rng.integers(0, problem.num_cameras, problem.num_points)
    since = (problem.camera_index - first[problem.point_index]) % problem.num_cameras
    return np.asarray(since < length)
