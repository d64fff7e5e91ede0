"""One more camera of a projective world: robust resection by direct linear transformation."""

from __future__ import annotations

import numpy as np

from sfmcpp.model.arrays import BoolArray, FloatArray

_SAMPLE, _SAMPLES, _BATCH = 6, 400, 100
_REFITS = 5


def resect(rays: FloatArray, points: FloatArray, limit: float, seed: int) -> tuple[FloatArray, BoolArray]:
    """Camera matrix from points and their images, some of them wrong (Hartley & Zisserman 2003, §7.1).

    Parameters
    ----------
    rays : (n, 3) float64
        Homogeneous positions in the frame of the image, the third coordinate one; n ≥ 6.
    points : (n, 4) float64
        Points of the world.
    limit : float
        Largest error of an inlier, in the frame of the image.
    seed : int
        Same seed, same camera.

    Returns
    -------
    camera : (3, 4) float64
        Of norm one, most depths positive.
    inliers : (n,) bool
        Points within the limit.
    """
    unit = points / np.linalg.norm(points, axis=1, keepdims=True)
    equations = _equations(rays, unit)
    rng = np.random.default_rng(seed)
    best, most = np.zeros(len(rays), dtype=np.bool_), -1
    for _ in range(_SAMPLES // _BATCH):
        chosen = np.argsort(rng.random((_BATCH, len(rays))), axis=1, kind="stable")[:, :_SAMPLE]
        cameras = _least(equations[chosen].reshape(_BATCH, -1, 12))
        good = _errors(cameras, rays, unit) < limit
        counts = good.sum(axis=1)
        if counts.max() > most:
            most, best = int(counts.max()), good[int(np.argmax(counts))]
    camera = np.zeros((3, 4))
    for _ in range(_REFITS):
        if best.sum() < _SAMPLE:
            break
        camera = _refitted(equations[best], unit[best])
        again = _errors(camera[None], rays, unit)[0] < limit
        if (again == best).all():
            break
        best = again
    sign = np.sign(np.median(np.sign(unit[best] @ camera[2]))) if best.any() else 1.0
    return (camera if sign >= 0 else -camera), best


def _equations(rays: FloatArray, points: FloatArray) -> FloatArray:
    """(n, 2, 12) of ``x p₃X − p₁X`` and ``y p₃X − p₂X``."""
    zero = np.zeros_like(points)
    first = np.concatenate([-points, zero, rays[:, :1] * points], axis=1)
    second = np.concatenate([zero, -points, rays[:, 1:2] * points], axis=1)
    return np.stack([first, second], axis=1)


def _least(equations: FloatArray) -> FloatArray:
    squares = np.swapaxes(equations, -1, -2) @ equations
    return np.asarray(np.linalg.eigh(squares)[1][..., 0].reshape(-1, 3, 4))


def _refitted(equations: FloatArray, points: FloatArray) -> FloatArray:
    """Least squares, the equations divided by the depths found before."""
    weight = np.ones(len(points))
    camera = np.zeros((3, 4))
    for _ in range(4):
        camera = _least((equations * weight[:, None, None]).reshape(1, -1, 12))[0]
        depth = np.abs(points @ camera[2])
        weight = 1 / np.maximum(depth, 1e-3 * depth.max())
    return camera


def _errors(cameras: FloatArray, rays: FloatArray, points: FloatArray) -> FloatArray:
    """(k, n) distance of the projections from the positions."""
    projected = cameras @ points.T
    with np.errstate(all="ignore"):
        off = projected[:, :2] / projected[:, 2:] - rays[:, :2].T
    error = np.linalg.norm(off, axis=1)
    return np.asarray(np.where(np.isfinite(error), error, np.inf))
