"""What residuals say once a robust adjustment has done its best: gross errors, by camera."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from sfmcpp.doctor.case import Case
from sfmcpp.doctor.finding import Finding, counted, numbers
from sfmcpp.doctor.trial import GROSS, NOTABLE_SHARE, Trial
from sfmcpp.model.arrays import BoolArray

# One hundredth of the image: less is a matter of calibration and noise.
_VISIBLE = 0.01
# Most of a camera's observations are wrong; where half of all are, it takes more to stand out.
_MOST = 0.5


# By the loss that has found them.
_ADVICE = {
    "cauchy": "solve with --loss huber or cauchy, or drop them (--fix)",
    "auto": "solve with --loss auto, or drop them (--fix): so many lead huber and cauchy away",
}


def fits_poorly(case: Case, trial: Trial) -> bool:
    """Whether the median error is gross: by the standard deviation stated, and to the eye."""
    return trial.median_px > max(GROSS * case.sigma_px, _VISIBLE * case.extent_px)


def outliers(case: Case) -> Iterator[Finding]:
    """Find gross errors, the cameras that have most of theirs wrong, and problems that fit nowhere."""
    trial = case.trial
    if case.is_misread or trial is None:
        return
    if fits_poorly(case, trial):
        yield _poor_fit(case, trial)
        return
    gross = trial.gross(case.sigma_px)
    views, shares = _shares(trial, gross)
    standing_out = max(_MOST, 0.5 * (1.0 + gross.mean()))
    wrong = numbers(np.flatnonzero((shares > standing_out) & (views > 0)))
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
        f"most observations of {counted(len(cameras), 'camera')} are off by more than {GROSS:g} σ after a "
        f"robust adjustment, {shares[worst]:.0%} of those of camera {case.name_of_camera(worst)}",
        "their start, calibration or matches are wrong: estimate these poses anew, or leave "
        "them out (Problem.with_cameras)",
        case.named_cameras(cameras),
        cameras=cameras,
        measures={"share": float(shares[worst])},
    )


def _outliers(case: Case, trial: Trial, gross: BoolArray) -> Finding:
    share = float(gross.mean())
    _, shares = _shares(trial, gross)
    worst = numbers(np.argsort(-shares, kind="stable")[:3])
    listed = ", ".join(f"{case.name_of_camera(k)} {shares[k]:.0%}" for k in worst if shares[k] > 0)
    limit = GROSS * max(trial.sigma_px, case.sigma_px)
    return Finding(
        "outliers",
        "warning" if share > NOTABLE_SHARE else "note",
        f"{counted(int(gross.sum()), 'observation')} ({share:.2%}) off by more than {limit:.3g} px after a "
        "robust adjustment",
        _ADVICE[trial.loss],
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
    if not 1 / GROSS < ratio < GROSS:
        yield Finding(
            "wrong-sigmas",
            "warning",
            f"the observations scatter by {trial.sigma_px:.2g} px, their stated σ is {case.sigma_px:.2g} px: "
            "losses, covariances and weights of constraints are off by that",
            "scale sigma_px, or leave it out",
            measures={"ratio": ratio},
        )
