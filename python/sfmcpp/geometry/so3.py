"""Rotations in any batch shape: matrices, rotation vectors, quaternions, angle-axis vectors.

``exp`` and ``log`` are those of SO(3): ``exp(v)`` turns by ``‖v‖`` [rad] about ``v``. The thesis (§1.3.1.2)
has Euler angles in their place, rot_e and its inverse.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.model.arrays import FloatArray

_NEARLY_HALF_TURN_RAD = 3.1


def hat(vectors: FloatArray) -> FloatArray:
    """Cross-product matrices (…, 3, 3) of vectors (…, 3): ``hat(a) @ b = a × b``."""
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    rows = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    return rows.reshape(*vectors.shape[:-1], 3, 3)


def vee(matrices: FloatArray) -> FloatArray:
    """Vectors (…, 3) of the antisymmetric part of matrices (…, 3, 3): the inverse of :func:`hat`."""
    difference = matrices - np.swapaxes(matrices, -1, -2)
    return np.asarray(0.5 * difference[..., (2, 0, 1), (1, 2, 0)])


def exp(vectors: FloatArray) -> FloatArray:
    """Rotation matrices (…, 3, 3) of rotation vectors (…, 3) [rad], by Rodrigues' formula."""
    cross = hat(np.asarray(vectors, dtype=np.float64))
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    # numpy's sinc is sin(πx)/(πx): no case for small angles is needed.
    sine, versine = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(np.eye(3) + sine * cross + versine * (cross @ cross))


def log(rotations: FloatArray) -> FloatArray:
    """Rotation vectors (…, 3) [rad], of length 0 to π, of rotation matrices (…, 3, 3)."""
    sine_axis = vee(rotations)
    angle = rotation_angle(rotations)[..., None]
    safe = np.where(angle < _NEARLY_HALF_TURN_RAD, angle, 0.0)
    ordinary = sine_axis / np.sinc(safe / np.pi)
    return np.where(angle < _NEARLY_HALF_TURN_RAD, ordinary, angle * _axis_near_half_turn(rotations, angle))


def rotation_angle(rotations: FloatArray) -> FloatArray:
    """Angles (…) [rad], 0 to π, of rotation matrices (…, 3, 3); exact at both ends."""
    sine = np.linalg.norm(vee(rotations), axis=-1)
    cosine = 0.5 * (np.trace(rotations, axis1=-2, axis2=-1) - 1)
    return np.asarray(np.arctan2(sine, cosine))


def nearest_rotation(matrices: FloatArray) -> FloatArray:
    """Rotations (…, 3, 3) that maximise ``trace(Rᵀ M)``: the nearest ones to matrices M (…, 3, 3)."""
    left, _, right = np.linalg.svd(matrices)
    left[..., :, 2] *= np.sign(np.linalg.det(left @ right))[..., None]
    return np.asarray(left @ right)


def _axis_near_half_turn(rotations: FloatArray, angle: FloatArray) -> FloatArray:
    """Unit axes (…, 3) from the longest column of the symmetric part, ``(1 − cos θ) a aᵀ + cos θ I``."""
    symmetric = 0.5 * (rotations + np.swapaxes(rotations, -1, -2))
    outer = symmetric - np.cos(angle)[..., None] * np.eye(3)
    longest = np.argmax(np.diagonal(outer, axis1=-2, axis2=-1), axis=-1)[..., None, None]
    column = np.take_along_axis(outer, longest, axis=-1)[..., 0]
    length = np.linalg.norm(column, axis=-1, keepdims=True)
    axis = np.divide(column, length, out=np.zeros_like(column), where=length > 0)
    forward = np.sum(axis * vee(rotations), axis=-1, keepdims=True) >= 0
    return np.asarray(np.where(forward, axis, -axis))


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
