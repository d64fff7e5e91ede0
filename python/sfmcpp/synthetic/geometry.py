"""Rotations and camera poses, many at a time."""

from __future__ import annotations

import numpy as np

from sfmcpp.model.problem import FloatArray

UP = np.array([0.0, 0.0, 1.0])
"""World direction that points up in every scene."""


def exp_so3(rotation_vectors_rad: FloatArray) -> FloatArray:
    """Turn rotation vectors into matrices (Rodrigues' formula), exact to rounding at small angles too.

    Parameters
    ----------
    rotation_vectors_rad : (N, 3) float64
        Axis times angle [rad].

    Returns
    -------
    (N, 3, 3) float64
    """
    w = np.asarray(rotation_vectors_rad, dtype=np.float64)
    angle = np.linalg.norm(w, axis=1)[:, None, None]
    # np.sinc(x) = sin(πx) / (πx), so neither coefficient divides by a small angle.
    sine = np.sinc(angle / np.pi)
    versine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    cross = cross_product_matrices(w)
    rotations: FloatArray = np.eye(3) + sine * cross + versine * (cross @ cross)
    return rotations


def cross_product_matrices(vectors: FloatArray) -> FloatArray:
    """``[v]×`` of each row of an (N, 3) array, as (N, 3, 3)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    rows = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1)
    return rows.reshape(-1, 3, 3)


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
    forward = _unit(targets - centres)
    right = _unit(np.cross(forward, up))
    down = np.cross(forward, right)
    return np.stack([right, down, forward, centres], axis=2)


def _unit(vectors: FloatArray) -> FloatArray:
    units: FloatArray = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return units
