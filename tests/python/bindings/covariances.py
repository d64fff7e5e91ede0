"""Covariances of observations, noise that has them, and the factor that whitens it, by NumPy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from projection import reference_residuals
from sfmcpp import Problem

Array = NDArray[np.float64]


def turned(angle: Array | float) -> Array:
    """Rotations (…, 2, 2) of the axes of an image."""
    c, s = np.cos(angle), np.sin(angle)
    return np.moveaxis(np.array([[c, -s], [s, c]]), [0, 1], [-2, -1])


def ellipses(sigmas: Array, angle: Array) -> Array:
    """Covariances (M, 2, 2) with standard deviations (M, 2) along axes turned by (M,) angles."""
    axes = turned(angle) * sigmas[:, None, :]
    return np.asarray(axes @ np.swapaxes(axes, 1, 2))


def random_covariances(count: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return ellipses(rng.uniform(0.3, 3.0, (count, 2)), rng.uniform(0, np.pi, count))


def whitening(covariances: Array) -> Array:
    """L (M, 2, 2), lower triangular, with LᵀL = Σ⁻¹."""
    return np.linalg.inv(np.linalg.cholesky(covariances))


def whitened_residuals(problem: Problem) -> Array:
    """(M, 2) of an independent projection."""
    assert problem.covariance_px2 is not None
    plain = reference_residuals(replace(problem, covariance_px2=None))
    return np.einsum("mij,mj->mi", whitening(problem.covariance_px2), plain)
