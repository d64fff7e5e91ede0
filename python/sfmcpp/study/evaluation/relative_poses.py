"""Errors of the relative poses of all pairs of images, and the area under their recall curve."""

from __future__ import annotations

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.so3 import rotation_angle
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray
from sfmcpp.model.checks import require_positive

# Baselines below this share of the truth's extent have no direction.
_NO_BASELINE = 1e-9


@checked(estimate=("n", 3, 4), truth=("n", 3, 4))
def relative_pose_errors_deg(estimate: FloatArray, truth: FloatArray) -> FloatArray:
    """Larger one of rotation and direction error of the relative pose of every pair of images.

    Parameters
    ----------
    estimate, truth : (n, 3, 4) float64
        Poses ``[R | c]`` of the same images, in any two worlds; an estimate that is no number is missing.

    Returns
    -------
    (n (n − 1) / 2,) float64
        Angles [deg]: of pairs (0, 1), (0, 2), … (1, 2), …; infinite where an image of the pair is missing.
        The direction is that from one centre to the other, in the frame of the first image; it has no error
        where the true centres are the same, and 180° where only the estimated ones are.
    """
    spread = float(np.ptp(truth[:, :, 3], axis=0).max(initial=0.0))
    rows = [_errors_from(row, estimate, truth, _NO_BASELINE * spread) for row in range(len(truth) - 1)]
    return np.concatenate([np.empty(0), *rows])


@checked(errors_deg=(ANY,))
def auc(errors_deg: FloatArray, threshold_deg: float) -> float:
    """Area under the recall curve up to a threshold, as a share of the largest possible.

    The curve goes straight from each error to the next and starts at (0, 0), as in P.-E. Sarlin et al.,
    "SuperGlue" (CVPR 2020), and benchmarks since.

    Parameters
    ----------
    errors_deg : (k,) float64
        Errors [deg], k ≥ 1; infinite for failures.
    threshold_deg : float
        Where the curve ends [deg].

    Returns
    -------
    float
        0 to 1.

    Raises
    ------
    InvalidArgument
        If there is no error, or the threshold is not positive.
    """
    require_positive("threshold_deg", threshold_deg)
    if not len(errors_deg):
        raise InvalidArgument("errors_deg: there are none, must be at least one")
    ordered = np.sort(errors_deg)
    inside = int(np.searchsorted(ordered, threshold_deg))
    errors = np.concatenate([[0.0], ordered[:inside], [threshold_deg]])
    recall = np.concatenate([np.arange(inside + 1), [inside]]) / len(ordered)
    area = np.sum(np.diff(errors) * (recall[1:] + recall[:-1])) / 2
    return float(area / threshold_deg)


def _errors_from(row: int, estimate: FloatArray, truth: FloatArray, no_baseline: float) -> FloatArray:
    """Errors (n − row − 1,) of the pairs of an image and all after it."""
    missing = np.isnan(estimate[row:, 0, 0])
    with np.errstate(invalid="ignore"):
        ours, true = (_seen_from(poses[row], poses[row + 1 :]) for poses in (estimate, truth))
        turn = rotation_angle(np.swapaxes(true[:, :, :3], 1, 2) @ ours[:, :, :3])
        apart = _angles(ours[:, :, 3], true[:, :, 3])
    apart[np.linalg.norm(true[:, :, 3], axis=1) <= no_baseline] = 0.0
    errors = np.rad2deg(np.maximum(turn, apart))
    errors[missing[1:] | missing[0]] = np.inf
    return np.asarray(errors)


def _seen_from(first: FloatArray, others: FloatArray) -> FloatArray:
    """Poses (k, 3, 4) in the frame of the first camera."""
    back = first[:, :3].T
    return np.concatenate([back @ others[:, :, :3], back @ (others[:, :, 3:] - first[:, 3:])], axis=2)


def _angles(one: FloatArray, other: FloatArray) -> FloatArray:
    """Angles (k,) [rad] between vectors (k, 3), exact for small ones; π where the first is zero."""
    sine = np.linalg.norm(np.cross(one, other), axis=1)
    angles = np.arctan2(sine, np.sum(one * other, axis=1))
    angles[~one.any(axis=1)] = np.pi
    return np.asarray(angles)
