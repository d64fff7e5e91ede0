"""Residuals after a robust adjustment: outliers, by camera."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sfmcpp.doctor.case import Case
from sfmcpp.doctor.finding import Finding, numbers
from sfmcpp.doctor.trial import GROSS, NOTABLE_SHARE, Trial, redundancy
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray
from sfmcpp.wording import counted

# Between this and its inverse a stated σ is a good one: keypoints of one kind scatter by so different σ.
_SIGMA_OFF = 2.0
# Most of a camera's observations are wrong; where half of all are, it takes more to stand out.
_MOST = 0.5


# By the loss that has found them.
_ADVICE = {
    "cauchy": "solve with --loss huber or cauchy, or drop them (--fix)",
    "auto": "solve with --loss auto, or drop them (--fix): huber and cauchy fail with this many",
}


def outliers(case: Case) -> Iterator[Finding]:
    """Find outliers, cameras with mostly outliers, and problems that nothing near the start fits."""
    trial = case.trial
    if case.is_misread or trial is None:
        return
    if case.fits_poorly(trial):
        yield _poor_fit(case, trial)
        return
    gross = trial.gross(case.sigma_px)
    views, shares = _outlier_shares(trial, gross)
    standing_out = max(_MOST, 0.5 * (1.0 + gross.mean()))
    wrong = numbers(np.flatnonzero((shares > standing_out) & (views > 0)))
    if wrong:
        yield _wrong_cameras_finding(case, wrong, shares)
    others = gross & ~np.isin(trial.problem.camera_index, wrong)
    if others.any():
        yield _outlier_finding(case, trial, others)


def _outlier_shares(trial: Trial, gross: BoolArray) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    cameras = trial.problem.num_cameras
    views = np.bincount(trial.problem.camera_index, minlength=cameras)
    return views, np.bincount(trial.problem.camera_index, gross, cameras) / np.maximum(views, 1)


def _poor_fit(case: Case, trial: Trial) -> Finding:
    return Finding(
        "poor-fit",
        "warning",
        f"the median error is {trial.median_px:.3g} px after a robust adjustment, at a stated σ of "
        f"{case.sigma_px:.3g} px: no state near the initial one explains the images",
        "if the initial state is good, check the indices of cameras and points; otherwise estimate it again "
        "(sfmcpp reconstruct)",
        measures={"median_px": trial.median_px},
    )


def _wrong_cameras_finding(case: Case, cameras: tuple[int, ...], shares: NDArray[np.float64]) -> Finding:
    worst = max(cameras, key=lambda camera: shares[camera])
    return Finding(
        "camera-contradicts",
        "warning",
        f"{counted(len(cameras), 'camera')} with most observations off by more than {GROSS:g} σ after a "
        f"robust adjustment ({shares[worst]:.0%} in camera {case.name_of_camera(worst)}): initial pose, "
        "calibration or matches are wrong",
        "estimate these poses again, or leave the cameras out (Problem.with_cameras)",
        case.named_cameras(cameras),
        cameras=cameras,
        measures={"share": float(shares[worst])},
    )


def _outlier_finding(case: Case, trial: Trial, gross: BoolArray) -> Finding:
    share = float(gross.mean())
    _, shares = _outlier_shares(trial, gross)
    worst = numbers(np.argsort(-shares, kind="stable")[:3])
    listed = ", ".join(f"{case.name_of_camera(k)} {shares[k]:.0%}" for k in worst if shares[k] > 0)
    limit = GROSS * max(trial.sigma_px, case.sigma_px)
    return Finding(
        "outliers",
        "warning" if share > NOTABLE_SHARE else "note",
        f"{counted(int(gross.sum()), 'observation')} ({share:.2%}) off by more than {limit:.3g} px"
        f"{_of_median(case.problem)} after a robust adjustment",
        _ADVICE[trial.loss],
        f"highest shares in cameras {listed}",
        cameras=worst,
        observations=numbers(case.given_rows(trial.problem, gross)),
        measures={"share": share, "limit_px": limit},
    )


def _of_median(problem: Problem) -> str:
    varied = problem.covariance_px2 is not None or (
        problem.sigma_px is not None and np.ptp(problem.sigma_px) > 0
    )
    return " at the median σ, others by as many of theirs," if varied else ""


def sigmas(case: Case) -> Iterator[Finding]:
    """Find stated standard deviations that the residuals contradict."""
    trial = case.trial
    stated = case.problem.sigma_px is not None or case.problem.covariance_px2 is not None
    if case.is_misread or trial is None or not stated:
        return
    scatter = _scatter_px(case, trial)
    ratio = scatter / case.sigma_px
    if not 1 / _SIGMA_OFF < ratio < _SIGMA_OFF:
        yield Finding(
            "wrong-sigmas",
            "warning",
            f"the observations scatter by {scatter:.2g} px, but the stated σ is {case.sigma_px:.2g} "
            "px: loss scale, covariances and weights of constraints are wrong by this ratio",
            "scale sigma_px, or leave it out",
            measures={"ratio": ratio},
        )


def _scatter_px(case: Case, trial: Trial) -> float:
    """Standard deviation of observations by their median and by squares, that nearer to the stated one [px].

    Near outliers and errors of the model enlarge the latter, tracks of two views diminish the former.
    """
    by_median = trial.sigma_px * np.sqrt(2 * trial.problem.num_observations / redundancy(trial.problem))
    best = case.best_fit
    if best is None:
        return float(by_median)
    by_squares = np.sqrt(case.squared_error(best) / redundancy(best.problem))
    return float(min(by_median, by_squares, key=lambda found: abs(np.log(found / case.sigma_px))))
