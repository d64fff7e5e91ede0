"""Wrong observations among the right ones."""

from __future__ import annotations

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_positive, require_share

# A stream of its own, as for perturbed starts.
_STREAM = (2,)


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
        Standard deviation of what is added to each coordinate [px]; some of it is small. Default: the
        observations are replaced by places uniform in the image.
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
    require_share("share", share)
    if sigma_px is not None:
        require_positive("sigma_px", sigma_px)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=_STREAM))
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
