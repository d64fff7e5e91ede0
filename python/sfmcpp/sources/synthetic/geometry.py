"""Rotations and camera poses, many at a time."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry.pinhole import unit
from sfmcpp.model.arrays import FloatArray

UP = np.array([0.0, 0.0, 1.0])
"""World direction that points up in every scene."""


def looking_at(centres: FloatArray, targets: FloatArray, up: FloatArray) -> FloatArray:
    """Aim cameras ``[R | c]`` from `centres` at `targets`, z forward, y down.

    Parameters
    ----------
    centres : (C, 3) float64
        Camera centres in the world.
    targets : (C, 3) or (3,) float64
        World points on the optical axes.
    up : (3,) float64
        World direction that points up in every image; not parallel to any optical axis.

    Returns
    -------
    (C, 3, 4) float64
        Rotation world_from_camera and centre of each camera.
    """
    forward = unit(targets - centres)
    right = unit(np.cross(forward, up))
    down = np.cross(forward, right)
    return np.stack([right, down, forward, centres], axis=2)
