"""Rotations between the forms in files: matrix, quaternion wxyz, angle-axis vector; all vectorised."""

from __future__ import annotations

import numpy as np

from sfmcpp.geometry.so3 import hat
from sfmcpp.model.arrays import FloatArray


def rotation_from_angle_axis(vectors: FloatArray) -> FloatArray:
    """Rotation matrices (C, 3, 3) of rotation vectors (C, 3) [rad], by Rodrigues' formula.

    The unit axis is formed first, so that neither tiny nor huge angles lose or overflow anything.
    """
    angles = np.hypot(np.hypot(vectors[:, 0], vectors[:, 1]), vectors[:, 2])[:, None]
    axes = np.divide(vectors, angles, out=np.zeros_like(vectors), where=angles > 0)
    cross = hat(axes)
    sine, versine = np.sin(angles)[:, :, None], 2 * np.sin(angles / 2)[:, :, None] ** 2
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def angle_axis_from_rotation(rotations: FloatArray) -> FloatArray:
    """Rotation vectors (C, 3) [rad] of length 0 to π; through quaternions, exact near 0 and near π."""
    quaternions = quaternion_from_rotation(rotations)
    w, xyz = quaternions[:, :1], quaternions[:, 1:]
    sine = np.linalg.norm(xyz, axis=1, keepdims=True)
    angle = 2 * np.arctan2(sine, w)
    return np.asarray(xyz * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 0))


def rotation_from_quaternion(quaternions: FloatArray) -> FloatArray:
    """Rotation matrices (C, 3, 3) of quaternions wxyz (C, 4) of any length but zero."""
    scaled = quaternions / np.abs(quaternions).max(axis=1, keepdims=True)
    unit = scaled / np.linalg.norm(scaled, axis=1, keepdims=True)
    w = unit[:, 0, None, None]
    cross = hat(unit[:, 1:])
    return np.asarray(np.eye(3) + 2 * w * cross + 2 * (cross @ cross))


def quaternion_from_rotation(rotations: FloatArray) -> FloatArray:
    """Convert rotation matrices (C, 3, 3) to unit quaternions wxyz (C, 4) with w ≥ 0.

    The four rows of 4 q qᵀ are all multiples of q; the longest one loses no digits (Shepperd 1978).
    """
    outer = _quaternion_outer_products(rotations)
    largest = np.argmax(np.diagonal(outer, axis1=1, axis2=2), axis=1)
    rows = outer[np.arange(len(outer)), largest]
    rows *= np.where(rows[:, :1] < 0, -1.0, 1.0)
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def _quaternion_outer_products(r: FloatArray) -> FloatArray:
    trace = np.trace(r, axis1=1, axis2=2)
    outer = np.empty((len(r), 4, 4))
    outer[:, 0, 0] = 1 + trace
    outer[:, 1:, 1:] = r + np.swapaxes(r, 1, 2) + (1 - trace)[:, None, None] * np.eye(3)
    difference = r - np.swapaxes(r, 1, 2)
    outer[:, 0, 1:] = outer[:, 1:, 0] = difference[:, (2, 0, 1), (1, 2, 0)]
    return outer
