"""How far an estimated trajectory is from the truth.

APE and RPE are named and defined as in M. Grupp's evo (github.com/MichaelGrupp/evo), which follows J. Sturm
et al., "A benchmark for the evaluation of RGB-D SLAM systems", IROS 2012.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_one_of, require_positive

RELATIONS = ("translation_part", "rotation_angle_deg", "full_transformation")
DELTA_UNITS = ("frames", "m")
# Steps of the truth below this say nothing of the scale: a standing vehicle.
SHORTEST_STEP_M = 0.01

Errors = dict[str, FloatArray]


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
    """
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
    return _parts(relative_poses(truth, estimate))


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
    return _parts(relative_poses(true, estimated))


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
    """``first⁻¹ second``: poses (n, 3, 4) of the second seen from the first."""
    back = np.swapaxes(first[:, :, :3], 1, 2)
    offset = second[:, :, 3:] - first[:, :, 3:]
    return np.concatenate([back @ second[:, :, :3], back @ offset], axis=2)


def _parts(differences: FloatArray) -> Errors:
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
    """Each pose with the later one whose distance along the path is nearest to `delta`."""
    wanted = path[:-1] + delta
    after = np.clip(np.searchsorted(path, wanted), np.arange(1, len(path)), len(path) - 1)
    before = np.maximum(after - 1, np.arange(1, len(path)))
    nearer = np.abs(path[before] - wanted) <= np.abs(path[after] - wanted)
    second = np.where(nearer, before, after)
    close = np.abs(path[second] - wanted) <= relative_tolerance * delta
    return np.stack([np.arange(len(path) - 1)[close], second[close]], axis=1)
