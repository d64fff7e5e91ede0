"""The loosely coupled baseline: SLAM first, then an extended Kalman filter on orientations (thesis §5.4.3.1).

One source tells turns from each time to the next and predicts, the other tells orientations and corrects. The
error w of an estimate R̂ is a rotation vector in its own frame, ``R = R̂ exp([w]×)``: the state is a rotation
and never leaves SO(3), its covariance has three rows.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model import SensorStream, Trajectory
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray, finite_array, shaped_array
from sfmcpp.sensors import Mounting, orientations, rotation_increment
from sfmcpp.sensors.inertial import rotations_at_samples

PREDICTORS = ("images", "sensor")
# Variance of an orientation of which nothing is known [rad²].
_UNKNOWN = np.pi**2


@dataclass(frozen=True, eq=False)
class FilteredOrientations:
    """Orientations by the filter at each of n times.

    Attributes
    ----------
    rotations : (n, 3, 3) float64
        Orientations, in the frame of the measured ones.
    covariances : (n, 3, 3) float64
        Covariance of the error w in ``R_true = R exp([w]×)`` [rad²].
    """

    rotations: FloatArray
    covariances: FloatArray


def filter_orientations(
    turns: ArrayLike,
    measured: ArrayLike,
    *,
    turn_sigma_rad: ArrayLike,
    measured_sigma_rad: ArrayLike,
) -> FilteredOrientations:
    """Fuse turns with orientations by a multiplicative extended Kalman filter.

    It starts at the first orientation. A step predicts ``R ← R T``, ``P ← Tᵀ P T + Q``, then corrects by
    ``K = P (P + V)⁻¹``, ``R ← R exp([K log(Rᵀ M)]×)``, ``P ← (I − K) P (I − K)ᵀ + K V Kᵀ``.

    Parameters
    ----------
    turns : (n − 1, 3, 3) float64
        Rotation T from each time to the next, ``R_kᵀ R_{k+1}``. NaN where nobody measured it: the estimate
        begins anew with the next orientation.
    measured : (n, 3, 3) float64
        Orientations M. NaN, but in the first, where there is none: the prediction stands.
    turn_sigma_rad : float, or broadcast to (n − 1, 3)
        Standard deviation of the error of each turn, about each axis of the body at its end [rad].
    measured_sigma_rad : float, or broadcast to (n, 3)
        Standard deviation of the error of each orientation, about each axis of the body [rad].

    Returns
    -------
    FilteredOrientations
        The filtered orientations and their covariances.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a standard deviation is negative or not finite, or there is no first orientation.
    """
    measured = shaped_array("measured", measured, (ANY, 3, 3))
    if not len(measured) or not np.isfinite(measured[0]).all():
        raise InvalidArgument("measured[0]: must be a rotation, the filter starts there")
    turns = shaped_array("turns", turns, (len(measured) - 1, 3, 3))
    noises = _covariances("turn_sigma_rad", turn_sigma_rad, len(turns))
    spreads = _covariances("measured_sigma_rad", measured_sigma_rad, len(measured))
    return _fused_orientations(turns, measured, noises, spreads)


def _fused_orientations(
    turns: FloatArray, measured: FloatArray, noises: FloatArray, spreads: FloatArray
) -> FilteredOrientations:
    """Fuse with covariances (…, 3, 3) of turns and orientations."""
    rotations, covariances = np.empty_like(measured), np.empty_like(measured)
    rotations[0], covariances[0] = measured[0], spreads[0]
    for k in range(1, len(measured)):
        predicted = _predict(rotations[k - 1], covariances[k - 1], turns[k - 1], noises[k - 1])
        rotations[k], covariances[k] = _correct(*predicted, measured[k], spreads[k])
    return FilteredOrientations(rotations, covariances)


@checked(rotations=(ANY, 3, 3))
def with_orientations(trajectory: Trajectory, rotations: ArrayLike) -> Trajectory:
    """Give a trajectory other orientations, and the positions that follow from them.

    The camera keeps what it did in its own frame: ``c_{k+1} = c_k + R_k S_kᵀ (s_{k+1} − s_k)`` with the
    trajectory's own orientations S and centres s, as a filter does that predicts by the poses of the images.

    Parameters
    ----------
    trajectory : Trajectory
        n poses.
    rotations : (n, 3, 3) float64
        Orientations R world_from_camera to take instead.

    Returns
    -------
    Trajectory
        At the same times, from the same first centre.

    Raises
    ------
    InvalidArgument
        If the shape is wrong or a number is not finite.
    """
    rotations = finite_array("rotations", rotations, (len(trajectory), 3, 3))
    steps = np.diff(trajectory.centres, axis=0)
    turned = np.einsum("nij,nkj,nk->ni", rotations[:-1], trajectory.rotations[:-1], steps)
    centres = trajectory.centres[0] + np.concatenate([np.zeros((1, 3)), np.cumsum(turned, axis=0)])
    return trajectory.with_poses(np.concatenate([rotations, centres[:, :, None]], axis=2))


@checked()
def filter_trajectory(
    trajectory: Trajectory,
    stream: SensorStream,
    mounting: Mounting,
    *,
    turn_sigma_rad_sqrt_s: float,
    orientation_sigma_rad: float,
    heading_sigma_rad: float | None = None,
    predict_by: str = "images",
) -> Trajectory:
    """Fuse the orientations of a finished SLAM run with those of a sensor, and recompute its positions.

    Predicted by the images, the filter is that of the thesis: their turns go into the prediction, and the
    sensor's orientations correct it. That asks for a sensor whose orientations do not drift. Predicted by the
    sensor, its rates go into the prediction, and the orientations of the images correct it. Either way the
    world is that of the trajectory: the sensor is tied to it at the first pose.

    Parameters
    ----------
    trajectory : Trajectory
        Poses of the camera, world_from_camera; any scale.
    stream : SensorStream
        Of kind ``"angular_rate"``, ``"orientation"`` or ``"pose"``; what it does not cover is not used.
    mounting : Mounting
        How the camera sits on the body.
    turn_sigma_rad_sqrt_s : float
        Random walk of the source that predicts, about each axis [rad/√s].
    orientation_sigma_rad : float
        Standard deviation of the orientations that correct, about each axis [rad].
    heading_sigma_rad : float, optional
        Another one about the vertical [rad]: gravity tells a sensor how it leans, and nothing of where it
        heads. Needs orientations in a world whose z axis is up; predicted by the images alone.
    predict_by : str
        ``"images"`` or ``"sensor"``.

    Returns
    -------
    Trajectory
        At the same times, from the same first pose.

    Raises
    ------
    InvalidArgument
        If an argument breaks its rule, or the stream is of another kind.
    """
    if predict_by not in PREDICTORS:
        raise InvalidArgument(f"predict_by = {predict_by!r}: must be one of {', '.join(PREDICTORS)}")
    if heading_sigma_rad is not None and (predict_by != "images" or stream.kind == "angular_rate"):
        raise InvalidArgument(
            f"heading_sigma_rad = {heading_sigma_rad!r}: must be None unless the images predict and the "
            f"sensor tells orientations; predict_by is {predict_by!r}, the stream one of {stream.kind!r}"
        )
    if predict_by == "images":
        turns = _relative_rotations(trajectory)
        seen_from_first = orientations(stream, trajectory.t_s)
        measured = trajectory.rotations[0] @ mounting.camera_rotation(seen_from_first)
    else:
        turns = mounting.camera_rotation(_measured_rotations(stream, trajectory.t_s))
        measured = trajectory.rotations
    spreads = _covariances("orientation_sigma_rad", orientation_sigma_rad, len(measured))
    if heading_sigma_rad is not None:
        heading = _covariances("heading_sigma_rad", heading_sigma_rad, len(measured)) - spreads
        up = _up_in_camera(stream, mounting, trajectory.t_s[0], seen_from_first)
        spreads = spreads + heading[:, :1, :1] * up[:, :, None] * up[:, None, :]
    walked = turn_sigma_rad_sqrt_s * np.sqrt(np.diff(trajectory.t_s))[:, None]
    noises = _covariances("turn_sigma_rad_sqrt_s", walked, len(turns))
    return with_orientations(trajectory, _fused_orientations(turns, measured, noises, spreads).rotations)


def _up_in_camera(
    stream: SensorStream, mounting: Mounting, start_s: float, seen_from_first: FloatArray
) -> FloatArray:
    """Direction (n, 3) of the sensor's z axis in the camera's frame, at the times of n orientations."""
    before = np.searchsorted(stream.t_s, start_s, side="right") - 1
    since = rotation_increment(stream, stream.t_s[before], start_s) if before >= 0 else None
    if since is None:
        raise InvalidArgument(
            f"stream: must tell the orientation at {start_s:g} s, where the trajectory begins"
        )
    up_at_first = (rotations_at_samples(stream)[before] @ since)[2]
    return np.asarray(up_at_first @ seen_from_first @ mounting.camera_from_body.T)


def _relative_rotations(trajectory: Trajectory) -> FloatArray:
    return np.asarray(np.swapaxes(trajectory.rotations[:-1], 1, 2) @ trajectory.rotations[1:])


def _measured_rotations(stream: SensorStream, t_s: FloatArray) -> FloatArray:
    """Rotation of the body from each time to the next; NaN where the stream does not cover it."""
    unknown = np.full((3, 3), np.nan)
    found = [rotation_increment(stream, *span) for span in pairwise(t_s.tolist())]
    return np.array([unknown if turn is None else turn for turn in found]).reshape(-1, 3, 3)


def _predict(
    rotation: FloatArray, covariance: FloatArray, turn: FloatArray, noise: FloatArray
) -> tuple[FloatArray, FloatArray]:
    if not np.isfinite(turn).all():
        return rotation, _UNKNOWN * np.eye(3)
    return rotation @ turn, turn.T @ covariance @ turn + noise


def _correct(
    rotation: FloatArray, covariance: FloatArray, measured: FloatArray, spread: FloatArray
) -> tuple[FloatArray, FloatArray]:
    if not np.isfinite(measured).all():
        return rotation, covariance
    # Two exact sources leave nothing to weigh; the pseudo-inverse keeps the prediction then.
    gain = covariance @ np.linalg.pinv(covariance + spread, hermitian=True)
    kept = np.eye(3) - gain
    step = so3.exp(gain @ so3.log(rotation.T @ measured))
    # Rounding adds up over thousands of products.
    corrected = so3.nearest_rotation(rotation @ step)
    return corrected, kept @ covariance @ kept.T + gain @ spread @ gain.T


def _covariances(name: str, sigma_rad: ArrayLike, count: int) -> FloatArray:
    """Diagonal (count, 3, 3) of standard deviations of any shape that broadcasts to (count, 3)."""
    try:
        sigmas = np.broadcast_to(np.asarray(sigma_rad, dtype=np.float64), (count, 3))
    except (TypeError, ValueError):
        raise InvalidArgument(f"{name}: must be numbers that broadcast to ({count}, 3)") from None
    if not (np.isfinite(sigmas) & (sigmas >= 0)).all():
        raise InvalidArgument(f"{name}: must be finite and not negative")
    return np.asarray(sigmas[:, :, None] ** 2 * np.eye(3))
