"""What residuals say once a robust adjustment has done its best: gross errors, by camera."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sfmcpp.doctor.case import Case
from sfmcpp.doctor.finding import Finding, counted, numbers
from sfmcpp.doctor.trial import Trial
from sfmcpp.model.arrays import BoolArray

# An error of ten standard deviations costs as much as a hundred good observations, …
_GROSS = 10.0
# … so from this share on a sum of squares is more about the gross errors than about all the rest.
_NOTABLE_SHARE = 1 / _GROSS**2
# One hundredth of the image: less is a matter of calibration and noise.
_VISIBLE = 0.01
# A robust loss holds as long as the good are more than the wrong.
_MOST = 0.5


def gross_errors(case: Case, trial: Trial) -> BoolArray:
    """(M,) observations of the trial farther off than ten standard deviations, as stated or as found."""
    return np.asarray(trial.errors_px > _GROSS * max(trial.sigma_px, case.sigma_px))


def fits_poorly(case: Case, trial: Trial) -> bool:
    """Whether the median error is gross: by the standard deviation stated, and to the eye."""
    return trial.median_px > max(_GROSS * case.sigma_px, _VISIBLE * case.extent_px)


def outliers(case: Case) -> Iterator[Finding]:
    """Find gross errors, the cameras that have most of theirs wrong, and problems that fit nowhere."""
    trial = case.trial
    if case.is_misread or trial is None:
        return
    if fits_poorly(case, trial):
        yield _poor_fit(case, trial)
        return
    gross = gross_errors(case, trial)
    views, shares = _shares(trial, gross)
    wrong = numbers(np.flatnonzero((shares > _MOST) & (views > 0)))
    if wrong:
        yield _cameras_wrong(case, wrong, shares)
    others = gross & ~np.isin(trial.problem.camera_index, wrong)
    if others.any():
        yield _outliers(case, trial, others)


def _shares(trial: Trial, gross: BoolArray) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    cameras = trial.problem.num_cameras
    views = np.bincount(trial.problem.camera_index, minlength=cameras)
    return views, np.bincount(trial.problem.camera_index, gross, cameras) / np.maximum(views, 1)


def _poor_fit(case: Case, trial: Trial) -> Finding:
    return Finding(
        "poor-fit",
        "warning",
        f"a robust adjustment leaves a median error of {trial.median_px:.3g} px, the stated σ is "
        f"{case.sigma_px:.3g} px: no state near the start explains the images",
        "if the start is good, indices of cameras or points are mixed up; else estimate it anew "
        "(sfmcpp reconstruct)",
        measures={"median_px": trial.median_px},
    )


def _cameras_wrong(case: Case, cameras: tuple[int, ...], shares: NDArray[np.float64]) -> Finding:
    worst = max(cameras, key=lambda camera: shares[camera])
    return Finding(
        "camera-contradicts",
        "warning",
        f"most observations of {counted(len(cameras), 'camera')} are off by more than {_GROSS:g} σ after a "
        f"robust adjustment, {shares[worst]:.0%} of those of camera {case.name_of_camera(worst)}",
        "their start, calibration or matches are wrong: estimate these poses anew, or leave them out",
        case.named_cameras(cameras),
        cameras=cameras,
        measures={"share": float(shares[worst])},
    )


def _outliers(case: Case, trial: Trial, gross: BoolArray) -> Finding:
    share = float(gross.mean())
    _, shares = _shares(trial, gross)
    worst = numbers(np.argsort(-shares, kind="stable")[:3])
    listed = ", ".join(f"{case.name_of_camera(k)} {shares[k]:.0%}" for k in worst if shares[k] > 0)
    limit = _GROSS * max(trial.sigma_px, case.sigma_px)
    return Finding(
        "outliers",
        "warning" if share > _NOTABLE_SHARE else "note",
        f"{counted(int(gross.sum()), 'observation')} ({share:.2%}) off by more than {limit:.3g} px after a "
        "robust adjustment",
        "solve with --loss huber or cauchy, or drop them (--fix)",
        f"most in cameras {listed}",
        cameras=worst,
        measures={"share": share, "limit_px": limit},
    )


def sigmas(case: Case) -> Iterator[Finding]:
    """Find stated standard deviations that the residuals do not bear out."""
    trial = case.trial
    stated = case.problem.sigma_px is not None or case.problem.covariance_px2 is not None
    if case.is_misread or trial is None or not stated:
        return
    ratio = trial.sigma_px / case.sigma_px
    if not 1 / _GROSS < ratio < _GROSS:
        yield Finding(
            "wrong-sigmas",
            "warning",
            f"the observations scatter by {trial.sigma_px:.2g} px, their stated σ is {case.sigma_px:.2g} px: "
            "losses, covariances and weights of constraints are off by that",
            "scale sigma_px, or leave it out",
            measures={"ratio": ratio},
        )
