"""Poses at times of no measurement: between two of them, and a little beyond the last."""

from __future__ import annotations

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import so3
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray, finite_array, require_increasing


@checked(pose=(3, 4), angular_rate_rad_s=(3,), velocity_m_s=(3,))
def predict_pose(
    pose: FloatArray, angular_rate_rad_s: FloatArray, velocity_m_s: FloatArray, seconds: float
) -> FloatArray:
    """Move on with constant velocity: thesis eqs 1.1–1.3.

    Parameters
    ----------
    pose : (3, 4) float64
        ``[R | c]`` world_from_body.
    angular_rate_rad_s : (3,) float64
        Angular rate in the body frame.
    velocity_m_s : (3,) float64
        Velocity in the world.
    seconds : float
        How far ahead, or back where negative.

    Returns
    -------
    (3, 4) float64
        ``[R exp(ω dt) | c + v dt]``.

    Raises
    ------
    InvalidArgument
        If a shape is wrong or a number is not finite.
    """
    pose = finite_array("pose", pose, (3, 4))
    turn = finite_array("angular_rate_rad_s", angular_rate_rad_s, (3,)) * seconds
    shift = finite_array("velocity_m_s", velocity_m_s, (3,)) * seconds
    return np.column_stack([pose[:, :3] @ so3.exp(turn), pose[:, 3] + shift])


def interpolate_rotations(t_s: FloatArray, rotations: FloatArray, times_s: FloatArray) -> FloatArray:
    """Turn at constant rate from each rotation to the next, and on beyond the ends.

    Parameters
    ----------
    t_s : (n,) float64
        Stamps [s], strictly increasing.
    rotations : (n, 3, 3) float64
        World_from_body at these stamps.
    times_s : (m,) float64
        Times asked for [s].

    Returns
    -------
    (m, 3, 3) float64
        ``R_i exp(u log(R_iᵀ R_{i+1}))``; the only rotation there is, if n is 1.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or the stamps do not increase.
    """
    t_s, times_s = _stamps(t_s, times_s)
    rotations = finite_array("rotations", rotations, (len(t_s), 3, 3))
    before, after, share = _brackets(t_s, times_s)
    start = rotations[before]
    turn = so3.log(np.swapaxes(start, 1, 2) @ rotations[after])
    return np.asarray(start @ so3.exp(share[:, None] * turn))


def interpolate_vectors(t_s: FloatArray, vectors: FloatArray, times_s: FloatArray) -> FloatArray:
    """Go in a straight line from each vector to the next, and on beyond the ends.

    Parameters
    ----------
    t_s : (n,) float64
        Stamps [s], strictly increasing.
    vectors : (n, k) float64
        Positions, distances or the like at these stamps.
    times_s : (m,) float64
        Times asked for [s].

    Returns
    -------
    (m, k) float64

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or the stamps do not increase.
    """
    t_s, times_s = _stamps(t_s, times_s)
    vectors = finite_array("vectors", vectors, (len(t_s), ANY))
    before, after, share = _brackets(t_s, times_s)
    return np.asarray(vectors[before] + share[:, None] * (vectors[after] - vectors[before]))


def interpolate_poses(t_s: FloatArray, poses: FloatArray, times_s: FloatArray) -> FloatArray:
    """Poses between stamps, and beyond the ends by constant velocity.

    Beyond the ends this is eqs 1.2 and 1.3 with the velocities of the last, or first, two poses.

    Parameters
    ----------
    t_s : (n,) float64
        Stamps [s], strictly increasing.
    poses : (n, 3, 4) float64
        ``[R | c]`` world_from_body.
    times_s : (m,) float64
        Times asked for [s].

    Returns
    -------
    (m, 3, 4) float64

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or the stamps do not increase.
    """
    poses = finite_array("poses", poses, (ANY, 3, 4))
    rotations = interpolate_rotations(t_s, poses[:, :, :3], times_s)
    centres = interpolate_vectors(t_s, poses[:, :, 3], times_s)
    return np.concatenate([rotations, centres[:, :, None]], axis=2)


def _stamps(t_s: FloatArray, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    t_s = finite_array("t_s", t_s, (ANY,))
    if not len(t_s):
        raise InvalidArgument("t_s: there is no stamp, must be at least one")
    require_increasing("t_s", t_s)
    return t_s, finite_array("times_s", times_s, (ANY,))


def _brackets(t_s: FloatArray, times_s: FloatArray) -> tuple[np.ndarray, np.ndarray, FloatArray]:
    """Rows before and after each time, and how far from one to the other; outside [0, 1] beyond the ends."""
    if len(t_s) == 1:
        alone = np.zeros(len(times_s), dtype=np.int64)
        return alone, alone, np.zeros(len(times_s))
    before = np.clip(np.searchsorted(t_s, times_s, side="right") - 1, 0, len(t_s) - 2)
    return before, before + 1, (times_s - t_s[before]) / (t_s[before + 1] - t_s[before])
