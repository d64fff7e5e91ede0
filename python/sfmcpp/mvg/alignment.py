"""Least-squares rigid and similarity alignment of two sets of corresponding points (Umeyama 1991)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import finite_array
from sfmcpp.model.problem import FloatArray
from sfmcpp.mvg._checks import require_not_negative

# Unit vectors are opposite where their sum is this short: its direction is lost in rounding.
_OPPOSITE = 1e-8


@dataclass(frozen=True)
class Alignment:
    """The transform ``target = scale · rotation · source + translation`` nearest to the data.

    Attributes
    ----------
    scale : float
        One for a rigid alignment.
    rotation : (3, 3) float64
        Rotation target_from_source.
    translation : (3,) float64
        Image of the source's origin.
    rms : float
        Root of the weighted mean squared distance that is left, in units of the target.
    undetermined : str
        What the points do not determine: nothing if empty, or ``"rotation about a line"`` (points on a
        line), or ``"rotation and scale"`` (all at one place). The values returned are then, of all that fit
        equally well, those of the smallest rotation, and scale one where that is open.
    """

    scale: float
    rotation: FloatArray
    translation: FloatArray
    rms: float
    undetermined: str

    def apply(self, points: ArrayLike) -> FloatArray:
        """Take points from source to target.

        Parameters
        ----------
        points : (..., 3) float64
            Points in the source's frame.

        Returns
        -------
        (..., 3) float64
        """
        return np.asarray(self.scale * (np.asarray(points) @ self.rotation.T) + self.translation)

    def apply_to_cameras(self, cameras: ArrayLike) -> FloatArray:
        """Take camera poses from source to target.

        Parameters
        ----------
        cameras : (..., 3, 4) float64
            ``[R | c]``, world_from_camera, in the source's frame.

        Returns
        -------
        (..., 3, 4) float64
        """
        poses = np.asarray(cameras, dtype=np.float64)
        centres = self.apply(poses[..., 3])
        return np.concatenate([self.rotation @ poses[..., :3], centres[..., None]], axis=-1)


def align_similarity(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None, *, collinear_ratio: float = 1e-9
) -> Alignment:
    """Find the similarity that takes `source` nearest to `target`, in the mean of squared distances.

    Parameters
    ----------
    source, target : (N, 3) float64
        Corresponding points, N ≥ 1.
    weights : (N,) float64, optional
        Weight of each squared distance, not negative, not all zero. Default: equal.
    collinear_ratio : float
        Points lie on a line where their second spread is at most this part of the first, in either set.

    Returns
    -------
    Alignment

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite or out of its range.
    """
    return _align(source, target, weights, collinear_ratio, free_scale=True)


def align_rigid(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None, *, collinear_ratio: float = 1e-9
) -> Alignment:
    """Find the rotation and translation that take `source` nearest to `target`; see :func:`align_similarity`.

    Parameters
    ----------
    source, target : (N, 3) float64
        Corresponding points, N ≥ 1.
    weights : (N,) float64, optional
        Weight of each squared distance, not negative, not all zero. Default: equal.
    collinear_ratio : float
        Points lie on a line where their second spread is at most this part of the first, in either set.

    Returns
    -------
    Alignment
        Of scale one.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite or out of its range.
    """
    return _align(source, target, weights, collinear_ratio, free_scale=False)


def _align(
    source: ArrayLike,
    target: ArrayLike,
    weights: ArrayLike | None,
    collinear_ratio: float,
    *,
    free_scale: bool,
) -> Alignment:
    a = finite_array("source", source, (-1, 3))
    b = finite_array("target", target, (len(a), 3))
    if not len(a):
        raise InvalidArgument("source: 0 points, must be at least 1")
    require_not_negative("collinear_ratio", collinear_ratio)
    part = _parts(weights, len(a))
    mean_a, mean_b = part @ a, part @ b
    dimension = min(_dimension(x - m, part, collinear_ratio) for x, m in ((a, mean_a), (b, mean_b)))
    rotation, trace = _rotation((part[:, None] * (b - mean_b)).T @ (a - mean_a), dimension)
    variance = float(part @ ((a - mean_a) ** 2).sum(axis=1))
    scale = trace / variance if free_scale and dimension else 1.0
    translation = mean_b - scale * rotation @ mean_a
    rms = np.sqrt(part @ ((scale * a @ rotation.T + translation - b) ** 2).sum(axis=1))
    undetermined = ("rotation and scale", "rotation about a line", "")[dimension]
    return Alignment(float(scale), rotation, translation, float(rms), undetermined)


def _parts(weights: ArrayLike | None, count: int) -> FloatArray:
    """Weights that sum to one."""
    values = np.ones(count) if weights is None else finite_array("weights", weights, (count,))
    if (values < 0).any():
        worst = int(np.argmin(values))
        raise InvalidArgument(f"weights[{worst}] = {values[worst]}: must not be negative")
    if not values.any():
        raise InvalidArgument("weights: all zero, at least one must be positive")
    return np.asarray(values / values.sum())


def _dimension(centred: FloatArray, part: FloatArray, collinear_ratio: float) -> int:
    """0 for points at one place, 1 on a line, 2 otherwise."""
    spread = np.linalg.svd(np.sqrt(part)[:, None] * centred, compute_uv=False)
    if not spread.size or spread[0] == 0:
        return 0
    return 1 if len(spread) < 2 or spread[1] <= collinear_ratio * spread[0] else 2


def _rotation(covariance: FloatArray, dimension: int) -> tuple[FloatArray, float]:
    """Rotation R of largest trace(Rᵀ · covariance), the smallest of several, and that trace."""
    u, d, vt = np.linalg.svd(covariance)
    if dimension == 0:
        return np.eye(3), 0.0
    if dimension == 1:
        return _smallest_rotation(vt[0], u[:, 0]), float(d[0])
    # Eq. 43: a reflection is undone along the direction that counts least.
    handed = np.array([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)])
    return np.asarray((u * handed) @ vt), float(d @ handed)


def _smallest_rotation(source: FloatArray, target: FloatArray) -> FloatArray:
    """Rotation by the smallest angle that takes one unit vector to another: a product of two reflections."""
    between = source + target
    if np.linalg.norm(between) < _OPPOSITE:
        between = np.eye(3)[np.argmin(np.abs(source))]
        between = between - (between @ source) * source
    half_turn = 2 * np.outer(between, between) / (between @ between) - np.eye(3)
    return np.asarray(half_turn @ (2 * np.outer(source, source) - np.eye(3)))
