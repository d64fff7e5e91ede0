"""Orientations that do not fit where the positions do: another body, or quaternions in another order."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry.so3 import (
    nearest_rotation,
    quaternion_from_rotation,
    rotation_angle,
    rotation_from_quaternion,
)
from sfmcpp.model.arrays import FloatArray

# Median error of orientations that is worth a word, and the share of it that an explanation may leave.
_TURNED_DEG, _EXPLAINED = 20.0, 0.2
# A body that turns less than this tells no order of quaternions: one turn of the world explains any.
_LEAST_DEG = 2.0
# What was read and what is right, by which way the numbers of a quaternion wxyz are rolled.
_ORDERS = ((-1, "x y z w", "w x y z"), (1, "w x y z", "x y z w"))


def warning_of_turned(estimate: FloatArray, aligned: FloatArray, truth: FloatArray) -> str:
    """Tell why orientations are off by more than an estimate errs, if it can be told; empty if not.

    Parameters
    ----------
    estimate, aligned, truth : (n, 3, 3) float64
        Rotations world_from_body as estimated, the same in the world of the truth, and the true ones.
    """
    usual = _median_deg(aligned, truth)
    if usual < _TURNED_DEG:
        return ""
    turned = aligned @ nearest_rotation((np.swapaxes(aligned, 1, 2) @ truth).mean(axis=0))
    as_read = _median_deg(_in_world_of(truth, estimate), truth)
    left = _median_deg(turned, truth)
    for roll, read, right in _ORDERS:
        reordered = rotation_from_quaternion(np.roll(quaternion_from_rotation(estimate), roll, axis=1))
        # Where a body hardly turns, one turn of all explains the other order nearly as well.
        off = _median_deg(_in_world_of(truth, reordered), truth)
        if as_read > _LEAST_DEG and off < min(_EXPLAINED * as_read, 0.5 * left):
            return (
                f"orientations are off by {usual:.0f}° in the median, but fit with the quaternions in "
                f"another order: they are read as {read}, the file seems to have {right}"
            )
    if left < _EXPLAINED * usual:
        return (
            f"all poses are turned by about {usual:.0f}° about axes of their own: they are of another body "
            "than the true ones (a camera and the vehicle), or in other axes"
        )
    return ""


def _in_world_of(truth: FloatArray, rotations: FloatArray) -> FloatArray:
    """Turned as a whole to where they fit the true ones best."""
    return np.asarray(nearest_rotation((truth @ np.swapaxes(rotations, 1, 2)).mean(axis=0)) @ rotations)


def _median_deg(rotations: FloatArray, truth: FloatArray) -> float:
    return float(np.median(np.rad2deg(rotation_angle(np.swapaxes(truth, 1, 2) @ rotations))))
