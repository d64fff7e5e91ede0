"""Robust rotation between two images of a camera that only turns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sfmcpp.geometry.pinhole import unit
from sfmcpp.model.arrays import BoolArray, FloatArray

# With half of the matches wrong, all samples miss once in 10⁸ times.
_NUM_SAMPLES = 64
_NUM_REFITS = 4


def fit_rotation(rays_1: FloatArray, rays_2: FloatArray, max_angle_rad: float, seed: int) -> FloatArray:
    """Rotation ``R`` with ``ray₁ ≈ R ray₂`` for most rays: two-point RANSAC, then least squares on inliers.

    Parameters
    ----------
    rays_1, rays_2 : (N, 3) float64
        Unit vectors, N ≥ 2.
    max_angle_rad : float
        Largest angle between ``ray₁`` and ``R ray₂`` of an inlier [rad].
    seed : int
        Same seed, same result.

    Returns
    -------
    (3, 3) float64
    """
    samples = _samples(rays_1, rays_2, np.random.default_rng(seed))
    best: FloatArray = samples[int(np.argmax(_num_inliers(samples, rays_1, rays_2, max_angle_rad)))]
    return refit_rotation(rays_1, rays_2, best, max_angle_rad)


def refit_rotation(
    rays_1: FloatArray, rays_2: FloatArray, rotation: FloatArray, max_angle_rad: float
) -> FloatArray:
    """Least-squares rotation of the inliers of `rotation`, and again of those of the result."""
    for _ in range(_NUM_REFITS):
        rotation = _least_squares_rotation(
            rays_1, rays_2, angles_rad(rays_1, rays_2, rotation) <= max_angle_rad
        )
    return rotation


def angles_rad(rays_1: FloatArray, rays_2: FloatArray, rotation: FloatArray) -> FloatArray:
    """(N,) angles [rad] between unit vectors ``ray₁`` and ``R ray₂``, exact for small ones too."""
    chord = np.linalg.norm(rays_1 - rays_2 @ rotation.T, axis=-1)
    return np.asarray(2 * np.arcsin(np.minimum(chord / 2, 1.0)))


def _samples(rays_1: FloatArray, rays_2: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(S, 3, 3) rotations, each from two matches drawn at random."""
    count = len(rays_1)
    first = rng.integers(count, size=_NUM_SAMPLES)
    second = (first + 1 + rng.integers(count - 1, size=_NUM_SAMPLES)) % count
    frame_1, frame_2 = (_frames(rays[first], rays[second]) for rays in (rays_1, rays_2))
    return np.asarray(frame_1 @ np.swapaxes(frame_2, 1, 2))


def _frames(a: FloatArray, b: FloatArray) -> FloatArray:
    """Right-handed orthonormal frames (S, 3, 3): a, its perpendicular towards b, and the normal of both.

    Of parallel a and b only the first column is not zero; :func:`_least_squares_rotation` makes a rotation of
    what follows.
    """
    normal = unit(np.cross(a, b))
    return np.stack([a, np.cross(normal, a), normal], axis=2)


def _num_inliers(
    samples: FloatArray, rays_1: FloatArray, rays_2: FloatArray, max_angle_rad: float
) -> NDArray[np.int64]:
    """(S,) rays within the angle of each sample: ray₁ᵀ R ray₂ is linear in R, so all are one product."""
    products = (rays_1[:, :, None] * rays_2[:, None, :]).reshape(-1, 9)
    # Not a matrix product: this small, threads of the BLAS would cost more than the work.
    cosines = np.einsum("sk,nk->sn", samples.reshape(-1, 9), products)
    return np.asarray(np.count_nonzero(cosines >= np.cos(max_angle_rad), axis=1))


def _least_squares_rotation(rays_1: FloatArray, rays_2: FloatArray, inliers: BoolArray) -> FloatArray:
    """Least-squares rotation of the inliers; the identity where they are too few."""
    if np.count_nonzero(inliers) < 2:
        return np.eye(3)
    u, _, vt = np.linalg.svd(rays_1[inliers].T @ rays_2[inliers])
    handed = np.array([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)])
    return np.asarray((u * handed) @ vt)
