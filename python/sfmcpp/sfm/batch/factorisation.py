"""Rank-4 factorisation of a full, rescaled measurement matrix (thesis §3.1.5.3; Sturm & Triggs 1996)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sfmcpp.model.arrays import FloatArray

_SETTLED = 1e-4


@dataclass(frozen=True, eq=False)
class Factors:
    """``λᵢⱼ qᵢⱼ ≈ Pᵢ Xⱼ``: s cameras, n points.

    Attributes
    ----------
    cameras : (s, 3, 4) float64
        P, the 3s rows orthonormal in their four columns.
    points : (n, 4) float64
        X.
    depths : (s, n) float64
        λ, the third coordinate of ``P X``.
    """

    cameras: FloatArray
    points: FloatArray

    @property
    def depths(self) -> FloatArray:
        """λ, the third coordinate of ``P X``."""
        return np.asarray(self.cameras[:, 2] @ self.points.T)

    def errors(self, rays: FloatArray) -> FloatArray:
        """(s, n) distance of the projections from the positions, in the frames of the images."""
        projected = self.cameras @ self.points.T
        with np.errstate(all="ignore"):
            position = projected[:, :2] / projected[:, 2:]
        return np.asarray(np.linalg.norm(np.swapaxes(position, 1, 2) - rays[:, :, :2], axis=2))


def factorise(rays: FloatArray, depths: FloatArray, iterations: int = 30) -> Factors:
    """Cameras and points of tracks that all images see, the depths iterated until they settle.

    Parameters
    ----------
    rays : (s, n, 3) float64
        Homogeneous positions in normalised frames, the third coordinate one.
    depths : (s, n) float64
        Projective depths to begin with.
    iterations : int
        How often the depths are taken anew from the factors, at most.

    Returns
    -------
    Factors
        With depths that are positive for most points of every camera.
    """
    weights, previous = depths, None
    for _ in range(iterations + 1):
        weights = balanced(rays, weights)
        cameras, points = _rank_four(rays, weights)
        weights = np.einsum("sni,sni->sn", rays, np.einsum("sij,nj->sni", cameras, points)) / (rays**2).sum(2)
        if previous is not None and np.abs(weights - previous).max() < _SETTLED:
            break
        previous = weights
    return _turned_positive(cameras, points)


def balanced(rays: FloatArray, depths: FloatArray, rounds: int = 3) -> FloatArray:
    """Depths scaled so that all columns, and all images, of the measurement matrix have the same norm."""
    square = (rays**2).sum(axis=2)
    scaled = depths
    for _ in range(rounds):
        scaled = scaled / np.sqrt((square * scaled**2).sum(axis=0, keepdims=True))
        scaled = scaled / np.sqrt((square * scaled**2).mean(axis=1, keepdims=True))
    return np.asarray(scaled)


def _rank_four(rays: FloatArray, depths: FloatArray) -> tuple[FloatArray, FloatArray]:
    matrix = np.swapaxes(rays * depths[:, :, None], 1, 2).reshape(-1, rays.shape[1])
    basis = np.linalg.eigh(matrix @ matrix.T)[1][:, -4:]
    return basis.reshape(-1, 3, 4), matrix.T @ basis


def _turned_positive(cameras: FloatArray, points: FloatArray) -> Factors:
    """Turn the signs of cameras and points so that most depths are positive."""
    depths = cameras[:, 2] @ points.T
    camera_sign, point_sign = np.ones(len(cameras)), np.ones(len(points))
    for _ in range(5):
        point_sign = np.where((np.sign(depths) * camera_sign[:, None]).sum(axis=0) < 0, -1.0, 1.0)
        camera_sign = np.where((np.sign(depths) * point_sign).sum(axis=1) < 0, -1.0, 1.0)
    return Factors(cameras * camera_sign[:, None, None], points * point_sign[:, None])
