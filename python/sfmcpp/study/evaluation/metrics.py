"""Metrics of trajectories and relative poses: 3D error, APE, RPE, area under the recall curve.

APE and RPE are named and defined as in M. Grupp's evo (github.com/MichaelGrupp/evo), which follows J. Sturm
et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.geometry.so3 import rotation_angle
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray
from sfmcpp.model.checks import require_one_of, require_positive

DELTA_UNITS = ("frames", "m")
# Steps of the truth below this say nothing of the scale: a standing vehicle.
SHORTEST_STEP_M = 0.01

Errors = dict[str, FloatArray]
# Baselines below this share of the truth's extent have no direction.
_NO_BASELINE = 1e-9


@dataclass(frozen=True)
class Statistics:
    """Statistics of errors, named as evo names them.

    Attributes
    ----------
    rmse, mean, median, std, min, max, sse : float
        Root mean square, mean, median, standard deviation (over n), least, largest, sum of squares.
    """

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float
    sse: float

    @classmethod
    def of(cls, errors: FloatArray) -> Statistics:
        """Statistics of errors (n,), n ≥ 1."""
        if not len(errors):
            raise InvalidArgument("errors: there are none, must be at least one")
        squares = np.square(errors)
        return cls(
            rmse=float(np.sqrt(np.mean(squares))),
            mean=float(np.mean(errors)),
            median=float(np.median(errors)),
            std=float(np.std(errors)),
            min=float(np.min(errors)),
            max=float(np.max(errors)),
            sse=float(np.sum(squares)),
        )


@checked(estimate=("n", 3, 4), truth=("n", 3, 4))
def mean_3d_error(estimate: FloatArray, truth: FloatArray) -> float:
    """Mean distance between estimated and true positions: thesis eq. 5.24.

    Parameters
    ----------
    estimate, truth : (n, 3, 4) float64
        Poses in the same frame.

    Returns
    -------
    float
        [m].

    Raises
    ------
    InvalidArgument
        If there is no pose.
    """
    if not len(estimate):
        raise InvalidArgument("estimate: 0 poses, must be at least one")
    return float(np.mean(_distances(estimate, truth)))


@checked(estimate=("n", 3, 4), truth=("n", 3, 4))
def scale_ratios(
    estimate: FloatArray, truth: FloatArray, shortest_step_m: float = SHORTEST_STEP_M
) -> FloatArray:
    """Length of each estimated step over that of the true one; their mean is thesis eq. 5.25.

    Parameters
    ----------
    estimate, truth : (n, 3, 4) float64
        Poses.
    shortest_step_m : float
        True steps shorter than this are left out.

    Returns
    -------
    (k,) float64
        1 where the scale is right.

    Raises
    ------
    InvalidArgument
        If `shortest_step_m` is not positive.
    """
    require_positive("shortest_step_m", shortest_step_m)
    estimated, true = (_distances(poses[1:], poses[:-1]) for poses in (estimate, truth))
    moving = true >= shortest_step_m
    return np.asarray(estimated[moving] / true[moving])


@checked(estimate=("n", 3, 4), truth=("n", 3, 4))
def ape(estimate: FloatArray, truth: FloatArray) -> Errors:
    """Absolute pose error.

    Parameters
    ----------
    estimate, truth : (n, 3, 4) float64
        Poses in the same frame.

    Returns
    -------
    dict of str to (n,) float64
        Of ``E = truth⁻¹ estimate``: the length of its translation [m] as ``"translation_part"``, the angle of
        its rotation [deg] as ``"rotation_angle_deg"``, the Frobenius norm of ``E − I`` as
        ``"full_transformation"``.
    """
    return _pose_errors(relative_poses(truth, estimate))


@checked(estimate=("n", 3, 4), truth=("n", 3, 4))
def rpe(
    estimate: FloatArray,
    truth: FloatArray,
    delta: float = 1.0,
    delta_unit: str = "frames",
    all_pairs: bool = False,
    relative_tolerance: float = 0.1,
) -> Errors:
    """Relative pose error: the drift over a number of frames or a distance.

    Parameters
    ----------
    estimate, truth : (n, 3, 4) float64
        Poses; the frames need not be the same.
    delta : float
        How far apart the poses of a pair are.
    delta_unit : str
        ``"frames"``, or ``"m"`` along the estimated path.
    all_pairs : bool
        Whether pairs start at every pose; if not, each starts where the one before it ended.
    relative_tolerance : float
        With `all_pairs` and ``"m"``: how far from `delta`, relative to it, the distance of a pair may be.

    Returns
    -------
    dict of str to (k,) float64
        As :func:`ape`, of ``E = (truth_i⁻¹ truth_j)⁻¹ (estimate_i⁻¹ estimate_j)``.

    Raises
    ------
    InvalidArgument
        If `delta` is not positive (for frames: whole), the unit is unknown, or there is no such pair.
    """
    pairs = pairs_apart(estimate, delta, delta_unit, all_pairs, relative_tolerance)
    if not len(pairs):
        raise InvalidArgument(f"delta = {delta:g} {delta_unit}: no two poses are that far apart")
    first, second = pairs.T
    true = relative_poses(truth[first], truth[second])
    estimated = relative_poses(estimate[first], estimate[second])
    return _pose_errors(relative_poses(true, estimated))


def pairs_apart(
    poses: FloatArray, delta: float, delta_unit: str, all_pairs: bool, relative_tolerance: float
) -> NDArray[np.int64]:
    """Rows (k, 2) of pairs of poses `delta` apart; the parameters are those of :func:`rpe`."""
    require_one_of("delta_unit", delta_unit, DELTA_UNITS)
    require_positive("delta", delta)
    if delta_unit == "frames":
        return _pairs_by_frames(len(poses), delta, all_pairs)
    path = np.concatenate([[0.0], np.cumsum(_distances(poses[1:], poses[:-1]))])
    return _all_pairs_by_path(path, delta, relative_tolerance) if all_pairs else _pairs_by_path(path, delta)


def relative_poses(first: FloatArray, second: FloatArray) -> FloatArray:
    """``first⁻¹ second``: poses (n, 3, 4) of the second seen from the first, which may be one for all."""
    back = np.swapaxes(first[:, :, :3], 1, 2)
    offset = second[:, :, 3:] - first[:, :, 3:]
    return np.concatenate([back @ second[:, :, :3], back @ offset], axis=2)


def _pose_errors(differences: FloatArray) -> Errors:
    rotations = differences[:, :, :3]
    return {
        "translation_part": np.linalg.norm(differences[:, :, 3], axis=1),
        "rotation_angle_deg": np.rad2deg(so3.rotation_angle(rotations)),
        "full_transformation": np.linalg.norm(differences - np.eye(3, 4), axis=(1, 2)),
    }


def _distances(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(one[:, :, 3] - other[:, :, 3], axis=1))


def _pairs_by_frames(count: int, delta: float, all_pairs: bool) -> NDArray[np.int64]:
    if delta != int(delta):
        raise InvalidArgument(f"delta = {delta:g} frames: must be a whole number")
    first = np.arange(0, count - int(delta), 1 if all_pairs else int(delta))
    return np.stack([first, first + int(delta)], axis=1)


def _pairs_by_path(path: FloatArray, delta: float) -> NDArray[np.int64]:
    rows = [0]
    for row, distance in enumerate(path):
        if distance - path[rows[-1]] >= delta:
            rows.append(row)
    return np.stack([rows[:-1], rows[1:]], axis=1).astype(np.int64)


def _all_pairs_by_path(path: FloatArray, delta: float, relative_tolerance: float) -> NDArray[np.int64]:
    """Each pose with the later one nearest to `delta` along the path, at a stop the first."""
    wanted, later = path[:-1] + delta, np.arange(1, len(path))
    after = np.clip(np.searchsorted(path, wanted), later, len(path) - 1)
    before = np.maximum(after - 1, later)
    nearer = np.abs(path[before] - wanted) <= np.abs(path[after] - wanted)
    second = np.maximum(np.searchsorted(path, path[np.where(nearer, before, after)]), later)
    close = np.abs(path[second] - wanted) <= relative_tolerance * delta
    return np.stack([np.arange(len(path) - 1)[close], second[close]], axis=1)


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
    if not len(truth):
        return np.empty(0)
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
    missing = np.logical_not(np.isfinite(estimate[row:]).all(axis=(1, 2)))
    with np.errstate(invalid="ignore"):
        ours, true = (relative_poses(poses[row : row + 1], poses[row + 1 :]) for poses in (estimate, truth))
        turn = rotation_angle(np.swapaxes(true[:, :, :3], 1, 2) @ ours[:, :, :3])
        apart = _angles(ours[:, :, 3], true[:, :, 3])
    apart[np.linalg.norm(true[:, :, 3], axis=1) <= no_baseline] = 0.0
    errors = np.rad2deg(np.maximum(turn, apart))
    errors[missing[1:] | missing[0]] = np.inf
    return np.asarray(errors)


def _angles(one: FloatArray, other: FloatArray) -> FloatArray:
    """Angles (k,) [rad] between vectors (k, 3), exact for small ones; π where the first is zero."""
    sine = np.linalg.norm(np.cross(one, other), axis=1)
    angles = np.arctan2(sine, np.sum(one * other, axis=1))
    angles[~one.any(axis=1)] = np.pi
    return np.asarray(angles)
