"""Cameras that stand upright: what is left open by a path along a straight line."""

from __future__ import annotations

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import FloatArray

# The y axis of a camera points down.
UP_IN_CAMERA = (0.0, -1.0, 0.0)
# Sine of the angle between the path and "up" below which one says nothing of the roll about the other: 10°.
_LEAST_ACROSS = 0.17


def upright_rotation(
    covariance: FloatArray, up_in_source: FloatArray, up_in_target: FloatArray
) -> FloatArray:
    """Rotation that brings one line onto another and one "up" as near to the other as the lines allow.

    Parameters
    ----------
    covariance : (3, 3) float64
        Of positions along the lines, target sourceᵀ; its first singular vectors are their directions.
    up_in_source, up_in_target : (3,) float64
        The direction that is up on either side, of any length.

    Returns
    -------
    (3, 3) float64
        Rotation target_from_source.

    Raises
    ------
    InvalidArgument
        If either "up" is zero or runs along its line.
    """
    left, _, right = np.linalg.svd(covariance)
    source = _frame("up_in_camera", right[0], up_in_source)
    target = _frame("up", left[:, 0], up_in_target)
    return np.asarray(target @ source.T)


def _frame(name: str, line: FloatArray, up: FloatArray) -> FloatArray:
    """Right-handed frame (3, 3): the line, "up" as far as it is across the line, and the normal of both."""
    across = up - (up @ line) * line
    length = float(np.linalg.norm(across))
    if not length > _LEAST_ACROSS * np.linalg.norm(up):
        raise InvalidArgument(f"{name}: is zero or along the path, must point across it to tell the roll")
    across /= length
    return np.stack([line, across, np.cross(line, across)], axis=1)
