"""Warnings about a metric model: undetermined focal lengths, critical motion, inconsistent observations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba import LinearModel, SolveOptions, residuals_px
from sfmcpp.model import Problem
from sfmcpp.sfm.batch.metric_model import LEAST_OBSERVATIONS
from sfmcpp.sfm.fit_statistics import pixel_variance

# Noise in standard deviations of the observations that is reckoned with at least, and the share of the normal
# matrix that is added to it: of a critical motion without noise both tell, not chance.
_LEAST_NOISE, _RIDGE = 0.05, 1e-12
# A metric model whose squared errors, cut off at so many medians of the projective ones, are so many times
# theirs is suspected: right ones have up to 1.8 on KITTI, Dinosaur, Kermit and Ladybug, wrong ones 2 to 3.
_FAR, _LEAST_FAR_PX, _SMALL_PX, _MISFIT = 5.0, 0.25, 0.05, 2.0


def misfit_warnings(
    problem: Problem, metric_problem: Problem, observations: NDArray[np.intp], max_error_px: float
) -> list[str]:
    """A warning where the metric model fits much worse than the projective one that was given.

    Parameters
    ----------
    problem : Problem
        The projective problem of M observations.
    metric_problem : Problem
        The metric one.
    observations : (M',) int
        Which of the M it holds.
    max_error_px : float
        Largest error that counts as it is [px].

    Returns
    -------
    list of str
        Of one sentence at most.
    """
    projective = np.linalg.norm(residuals_px(problem), axis=1)
    limit = min(max(_FAR * float(np.median(projective)), _LEAST_FAR_PX), max_error_px)
    metric = np.full(problem.num_observations, limit)
    metric[observations] = np.linalg.norm(residuals_px(metric_problem), axis=1)
    of_metric, of_projective = (
        float(np.mean(np.minimum(errors, limit) ** 2)) for errors in (metric, projective)
    )
    ratio = (of_metric + _SMALL_PX**2) / (of_projective + _SMALL_PX**2)
    if ratio < _MISFIT:
        return []
    return [
        f"the metric model fits {ratio:.1f} times worse than the projective one: parts of it may be "
        "distorted, or the assumptions on the intrinsics are wrong"
    ]


def left_out_warnings(problem: Problem, cameras: NDArray[np.intp]) -> list[str]:
    """A warning that names the cameras of `problem` that are not among `cameras` (C',)."""
    gone = np.setdiff1d(np.arange(problem.num_cameras), cameras)
    if not len(gone):
        return []
    names = problem.metadata.image_names
    listed = ", ".join(names[i] if names else str(i) for i in gone.tolist())
    return [f"cameras with fewer than {LEAST_OBSERVATIONS} consistent observations were left out: {listed}"]


def focal_sigmas(problem: Problem, threads: int) -> tuple[float, float]:
    """Largest standard deviation of a focal length over itself: as observed, and with no noise too little.

    Parameters
    ----------
    problem : Problem
        At the optimum, with free focal lengths.
    threads : int
        The same bits for any.

    Returns
    -------
    float, float
        For the noise that the residuals tell, and for a small one where this is less: large for a critical
        motion even where the observations are exact.
    """
    model = LinearModel(problem, (), SolveOptions(threads=threads), _RIDGE)
    column = model.parameter_names.index("f")
    of_unit_noise = np.sqrt(np.maximum(model.covariance(cameras="all").cameras[:, column, column], 0.0))
    noise = np.sqrt(pixel_variance(model))
    relative = float((of_unit_noise / problem.intrinsics[problem.intrinsics_index, 0]).max())
    return relative * noise, relative * max(noise, _LEAST_NOISE)


def no_model_message(focal: str) -> str:
    """Reason where no metric frame has its points in front of its cameras, for this kind of `focal`."""
    return (
        f"no calibration with {_focal_text(focal)} places the points in front of the cameras: the "
        "assumptions on the intrinsics or the projective reconstruction are wrong, or the motion does not "
        "determine the calibration"
    )


def contradiction(kept: float, focal: str) -> str:
    """Reason where only a share `kept` of the observations agrees."""
    share = f"{100 * kept:.0f} %"
    return f"only {share} of the observations are consistent with a metric model with {_focal_text(focal)}"


def critical_motion(sigma: float) -> str:
    """Reason where the focal length has the relative standard deviation `sigma`."""
    return (
        f"the motion does not determine the focal length (relative standard deviation {sigma:.2g}): this "
        "happens if cameras only move along a line, or turn about parallel viewing axes"
    )


def _focal_text(focal: str) -> str:
    return {
        "shared": "one focal length for all cameras",
        "varying": "a focal length for each camera",
        "known": "the known intrinsics",
    }[focal]
