"""Points and cameras of a projective world by direct linear transformation: triangulation and resection."""

from __future__ import annotations

import numpy as np

from sfmcpp.model.arrays import BoolArray, FloatArray, largest_of_each
from sfmcpp.sfm.batch.measurements import Indices, Measurements

_LINEAR_ROUNDS, _ROBUST_ROUNDS = 3, 4
_LEAST_DEPTH_RATIO = 1e-3
_SAMPLE_SIZE, _SAMPLES, _BATCH = 6, 400, 100
_REFITS = 5


def triangulate(
    measured: Measurements, cameras: FloatArray, rows: Indices, usual_px: float | None = None
) -> FloatArray:
    """Unit points (N, 4) from the observations `rows`; nan for tracks with fewer than two of them.

    Linear least squares of ``x p₃X − p₁X`` and ``y p₃X − p₂X`` (Hartley & Zisserman 2003, §12.2), divided
    by the depths found before, which makes them errors of reprojection. With `usual_px`, those above it
    count by their length and not by its square.
    """
    order = rows[np.argsort(measured.track[rows], kind="stable")]
    track = measured.track[order]
    starts = np.flatnonzero(np.diff(track, prepend=-1))
    tracks, counts = track[starts], np.diff(starts, append=len(track))
    matrices, rays = cameras[measured.image[order]], measured.rays[order]
    scale = measured.frames[measured.image[order], 0]
    equations = (rays[:, :2, None] * matrices[:, None, 2] - matrices[:, :2]) * scale[:, None, None]
    weight = 1 / np.linalg.norm(matrices[:, 2], axis=1)
    points = np.zeros((len(tracks), 4))
    for number in range(_LINEAR_ROUNDS + (_ROBUST_ROUNDS if usual_px else 0)):
        weighted = equations * weight[:, None, None]
        squares = np.add.reduceat(np.einsum("mki,mkj->mij", weighted, weighted), starts, axis=0)
        points = np.linalg.eigh(squares)[1][:, :, 0]
        spread = np.repeat(points, counts, axis=0)
        depth = np.abs(np.einsum("mi,mi->m", matrices[:, 2], spread))
        floor = _LEAST_DEPTH_RATIO * np.repeat(np.maximum.reduceat(depth, starts), counts)
        weight = 1 / np.maximum(depth, floor)
        if usual_px and number >= _LINEAR_ROUNDS - 1:
            error = np.linalg.norm(np.einsum("mki,mi->mk", equations, spread), axis=1) * weight
            weight = weight / np.sqrt(np.maximum(1.0, error / usual_px))
    result = np.full((measured.num_tracks, 4), np.nan)
    result[tracks[counts >= 2]] = points[counts >= 2]
    return result


def reprojection_errors_px(measured: Measurements, cameras: FloatArray, points: FloatArray) -> FloatArray:
    """(M,) distance of each observation from its projection; infinite where that is behind or nowhere.

    Cameras and points have signs in which depths are positive: a scene in front of its cameras has some,
    whatever the frame of the world (Hartley & Zisserman 2003, §21.1).
    """
    projected = np.einsum("mij,mj->mi", cameras[measured.image], points[measured.track])
    with np.errstate(all="ignore"):
        off = projected[:, :2] / projected[:, 2:] - measured.rays[:, :2]
        error = np.linalg.norm(off, axis=1) * measured.frames[measured.image, 0]
        return np.asarray(np.where(np.isfinite(error) & (projected[:, 2] > 0), error, np.inf))


def triangulate_without_outliers(
    measured: Measurements, cameras: FloatArray, kept: BoolArray, limit_px: float, rounds: int = 5
) -> tuple[FloatArray, BoolArray]:
    """Triangulate, and leave out the observation of each track that is off most, until none is by more.

    The points are those of the observations that are kept.
    """
    current = kept & np.isfinite(cameras[measured.image, 0, 0])
    points = np.full((measured.num_tracks, 4), np.nan)
    doubtful = np.ones(measured.num_tracks, dtype=np.bool_)
    for number in range(rounds):
        looked_at = current & doubtful[measured.track]
        new = triangulate(measured, cameras, np.flatnonzero(looked_at), limit_px / 2)
        points[doubtful] = _with_points_in_front(measured, cameras, new, looked_at)[doubtful]
        error = np.where(looked_at, reprojection_errors_px(measured, cameras, points), -1.0)
        worst = largest_of_each(measured.track[looked_at], error[looked_at], measured.num_tracks)
        bad = (error > limit_px) & (error >= worst[measured.track])
        current = current & ~bad & ~((error > limit_px) & (number == rounds - 1))
        doubtful = worst > limit_px
        if not doubtful.any():
            break
    seen = np.bincount(measured.track[current], minlength=measured.num_tracks)
    current = current & (seen[measured.track] >= 2)
    points = triangulate(measured, cameras, np.flatnonzero(current))
    return _with_points_in_front(measured, cameras, points, current), current


def _with_points_in_front(
    measured: Measurements, cameras: FloatArray, points: FloatArray, kept: BoolArray
) -> FloatArray:
    """The points (N, 4) with the sign that puts them in front of most of the cameras that see them."""
    image, track = measured.image[kept], measured.track[kept]
    side = np.sign(np.einsum("mj,mj->m", cameras[image, 2], points[track]))
    total = np.bincount(track, np.nan_to_num(side), measured.num_tracks)
    return np.where(total[:, None] < 0, -points, points)


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
        chosen = np.argsort(rng.random((_BATCH, len(rays))), axis=1, kind="stable")[:, :_SAMPLE_SIZE]
        cameras = _null_vectors(equations[chosen].reshape(_BATCH, -1, 12))
        good = _errors(cameras, rays, unit) < limit
        counts = good.sum(axis=1)
        if counts.max() > most:
            most, best = int(counts.max()), good[int(np.argmax(counts))]
    camera = np.zeros((3, 4))
    for _ in range(_REFITS):
        if best.sum() < _SAMPLE_SIZE:
            break
        camera = _reweighted_camera(equations[best], unit[best])
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


def _null_vectors(equations: FloatArray) -> FloatArray:
    squares = np.swapaxes(equations, -1, -2) @ equations
    return np.asarray(np.linalg.eigh(squares)[1][..., 0].reshape(-1, 3, 4))


def _reweighted_camera(equations: FloatArray, points: FloatArray) -> FloatArray:
    """Least squares, the equations divided by the depths found before."""
    weight = np.ones(len(points))
    camera = np.zeros((3, 4))
    for _ in range(4):
        camera = _null_vectors((equations * weight[:, None, None]).reshape(1, -1, 12))[0]
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
