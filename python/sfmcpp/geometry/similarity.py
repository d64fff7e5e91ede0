"""Similarity transformations, and their least-squares fits to points or poses.

These fits are the only ones of the package. What leaves them open is refused by name: fewer than two pairs
that count; points on a line, about which any rotation fits (poses on a line have a fit); positions that are
all the same; a target that runs against its source whatever the rotation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.so3 import hat, nearest_rotation
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray, finite_array
from sfmcpp.model.checks import require_positive, require_rotation

# Thinnest extent relative to the longest one that is more than rounding.
THINNEST_EXTENT = 1e-7
# Positions that differ by no more than this share of their distance from the origin differ by rounding.
SAME_PLACE = 1e-12


@dataclass(frozen=True, eq=False)
class Similarity:
    """The map ``x ↦ scale · rotation · x + translation``: H of thesis eq. 5.16.

    Parameters
    ----------
    scale : float
        Positive.
    rotation : (3, 3) float64
        Rotation target_from_source.
    translation : (3,) float64
        Where the source's origin goes.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, the scale is not positive, or `rotation` is none.
    """

    scale: float
    rotation: FloatArray
    translation: FloatArray

    if TYPE_CHECKING:  # what is given need not be what is held

        def __init__(self, scale: float, rotation: ArrayLike, translation: ArrayLike) -> None: ...

    def __post_init__(self) -> None:
        require_positive("scale", self.scale)
        object.__setattr__(self, "rotation", finite_array("rotation", self.rotation, (3, 3)))
        object.__setattr__(self, "translation", finite_array("translation", self.translation, (3,)))
        require_rotation("rotation", self.rotation)

    @classmethod
    def identity(cls) -> Similarity:
        """The map that changes nothing."""
        return cls(1.0, np.eye(3), np.zeros(3))

    def apply(self, points: ArrayLike) -> FloatArray:
        """Images (…, 3) of points (…, 3): thesis eq. 5.17."""
        return np.asarray(self.scale * (np.asarray(points) @ self.rotation.T) + self.translation)

    def apply_to_poses(self, poses: FloatArray) -> FloatArray:
        """Images (…, 3, 4) of poses ``[R | c]`` world_from_camera (…, 3, 4): thesis eq. 5.16.

        The rotation stays a rotation: what a camera sees does not depend on the scale.
        """
        rotations = self.rotation @ poses[..., :3]
        # Row by row: a pose must go to the same bits alone and among others.
        centres = self.apply(poses[..., None, :, 3])[..., 0, :]
        return np.concatenate([rotations, centres[..., None]], axis=-1)

    def move(self, problem: Problem) -> None:
        """Move a problem of metric cameras, in place: its points, cameras, and the sensors of its rigs.

        An origin of the world that its metadata tell stays as it is.

        Raises
        ------
        InvalidArgument
            If the problem is projective.
        """
        if not problem.is_metric:
            raise InvalidArgument(f"problem: {problem.camera_model} cameras are not moved by a similarity")
        problem.cameras[:] = self.apply_to_poses(problem.cameras)
        problem.points[:] = self.apply(problem.points)
        if problem.rigs is not None:
            problem.rigs = problem.rigs.scaled(self.scale)

    def inverse(self) -> Similarity:
        """The map back."""
        back = self.rotation.T
        return Similarity(1 / self.scale, back, -(back @ self.translation) / self.scale)

    def __matmul__(self, first: Similarity) -> Similarity:
        return Similarity(
            self.scale * first.scale, self.rotation @ first.rotation, self.apply(first.translation)
        )


def motions_of_positions(positions: FloatArray) -> FloatArray:
    """(n, 3, 7) response of positions (n, 3) to turn, shift and change of scale: ``ω × X + v + s X``."""
    identity = np.broadcast_to(np.eye(3), (len(positions), 3, 3))
    return np.concatenate([-hat(positions), identity, positions[:, :, None]], axis=2)


@dataclass(frozen=True, eq=False)
class PointMoments:
    """Weighted means, extents and covariance of pairs of points (Umeyama 1991, eqs 34–38).

    Attributes
    ----------
    shares : (n,) float64
        Weights of the pairs, summing to one.
    source_mean, target_mean : (3,) float64
        Means of either side.
    covariance : (3, 3) float64
        ``Σ w (target − mean)(source − mean)ᵀ``.
    source_extents, target_extents : (3,) float64
        Root mean squared extents of either side along its own main directions, the longest first.
    """

    shares: FloatArray
    source_mean: FloatArray
    target_mean: FloatArray
    covariance: FloatArray
    source_extents: FloatArray
    target_extents: FloatArray

    @classmethod
    def of(cls, source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None) -> PointMoments:
        """Sum up pairs of points.

        Parameters
        ----------
        source, target : (n, 3) array-like
            Pairs of points, n ≥ 1.
        weights : (n,) array-like, optional
            Weight of each pair, not negative, not all zero. Default: all equal.

        Returns
        -------
        PointMoments

        Raises
        ------
        InvalidArgument
            If the shapes differ, there is no pair, a number is not finite, or a weight is out of its range.
        """
        source = finite_array("source", source, (ANY, 3))
        target = finite_array("target", target, (len(source), 3))
        if not len(source):
            raise InvalidArgument("source: 0 points, must be at least 1")
        shares = _shares(weights, len(source))
        means = shares @ source, shares @ target
        x, y = source - means[0], target - means[1]
        covariance = y.T @ (shares[:, None] * x)
        return cls(shares, *means, covariance, _main_extents(x, shares), _main_extents(y, shares))

    @property
    def count(self) -> int:
        """Number of pairs whose weight is not zero."""
        return int(np.count_nonzero(self.shares))

    @property
    def source_variance(self) -> float:
        """Mean squared distance of the source from its mean."""
        return float(self.source_extents @ self.source_extents)

    @property
    def target_variance(self) -> float:
        """Mean squared distance of the target from its mean."""
        return float(self.target_extents @ self.target_extents)

    def scale(self, rotation: FloatArray) -> float:
        """Best scale for a rotation target_from_source (3, 3): negative if both sides run against each other.

        The source must not be all at one place.
        """
        return float(np.sum(rotation * self.covariance)) / self.source_variance

    def translation(self, rotation: FloatArray, scale: float) -> FloatArray:
        """Best translation (3,) for a rotation (3, 3) and a scale."""
        return np.asarray(self.target_mean - scale * (rotation @ self.source_mean))


@checked()
def fit_similarity(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None, with_scale: bool = True
) -> Similarity:
    """Fit the similarity that brings `source` nearest to `target`, in the least-squares sense.

    Closed form of S. Umeyama, "Least-squares estimation of transformation parameters between two point
    patterns", PAMI 1991.

    Parameters
    ----------
    source, target : (n, 3) array-like
        Pairs of points, n ≥ 3 and not all on a line.
    weights : (n,) array-like, optional
        Weight of each pair's squared distance, not negative. Default: all equal.
    with_scale : bool
        Whether to fit the scale too; if not, it is 1.

    Returns
    -------
    Similarity
        target_from_source.

    Raises
    ------
    InvalidArgument
        If the shapes differ, a number is not finite, a weight is negative, fewer than three pairs count, or
        the points of either side lie on a line, about which no rotation is better than another, or are all
        the same but for rounding.
    """
    moments = _moments(source, target, weights)
    _require_plane(moments)
    _require_movement(moments)
    return _with_rotation(moments, nearest_rotation(moments.covariance), with_scale)


@checked()
def fit_pose_similarity(
    source: ArrayLike, target: ArrayLike, weights: ArrayLike | None = None, with_scale: bool = True
) -> Similarity:
    """Fit the similarity that brings poses nearest to poses, by their positions and their orientations.

    The rotation maximises ``trace(Rᵀ (C / (σ_source σ_target) + Σ w R_target R_sourceᵀ))``: positions
    measured by their own spread, so that no unit of length enters; the scale and the translation are then the
    best for that rotation. Unlike :func:`fit_similarity` this holds on a straight line.

    Parameters
    ----------
    source, target : (n, 3, 4) array-like
        Pairs of poses ``[R | c]``, n ≥ 2, at more than one position.
    weights : (n,) array-like, optional
        Weight of each pair, not negative. Default: all equal.
    with_scale : bool
        Whether to fit the scale too; if not, it is 1.

    Returns
    -------
    Similarity
        target_from_source.

    Raises
    ------
    InvalidArgument
        If the shapes differ, a number is not finite, a weight is negative, or a side does not move.
    """
    source = finite_array("source", source, (ANY, 3, 4))
    target = finite_array("target", target, (len(source), 3, 4))
    moments = _moments(source[:, :, 3], target[:, :, 3], weights)
    _require_movement(moments)
    turns = target[:, :, :3] @ np.swapaxes(source[:, :, :3], 1, 2)
    orientation = np.einsum("n,nij->ij", moments.shares, turns)
    spread = np.sqrt(moments.source_variance * moments.target_variance)
    return _with_rotation(moments, nearest_rotation(moments.covariance / spread + orientation), with_scale)


def _moments(source: ArrayLike, target: ArrayLike, weights: ArrayLike | None) -> PointMoments:
    moments = PointMoments.of(source, target, weights)
    if moments.count < 2:
        raise InvalidArgument(f"source: {moments.count} pairs count, must be two or more")
    return moments


def _require_plane(moments: PointMoments) -> None:
    for name, extents in (("source", moments.source_extents), ("target", moments.target_extents)):
        if not extents[1] > THINNEST_EXTENT * extents[0]:
            raise InvalidArgument(
                f"{name}: the points lie on a line, about which any rotation fits: must span a plane"
            )


def _require_movement(moments: PointMoments) -> None:
    for name, mean, variance in (
        ("source", moments.source_mean, moments.source_variance),
        ("target", moments.target_mean, moments.target_variance),
    ):
        if not np.sqrt(variance) > SAME_PLACE * np.linalg.norm(mean):
            raise InvalidArgument(f"{name}: all positions are the same, must differ")


def _with_rotation(moments: PointMoments, rotation: FloatArray, with_scale: bool) -> Similarity:
    scale = moments.scale(rotation) if with_scale else 1.0
    if not scale > 0:
        raise InvalidArgument("target: runs against source whatever the rotation, no positive scale fits")
    return Similarity(scale, rotation, moments.translation(rotation, scale))


def _shares(weights: ArrayLike | None, count: int) -> FloatArray:
    """Weights (n,) that sum to one."""
    given = np.ones(count) if weights is None else finite_array("weights", weights, (count,))
    if (given < 0).any():
        row = int(np.argmin(given))
        raise InvalidArgument(f"weights[{row}] = {given[row]}: must not be negative")
    if not given.any():
        raise InvalidArgument("weights: all zero, at least one must be positive")
    return np.asarray(given / given.sum())


def _main_extents(centred: FloatArray, shares: FloatArray) -> FloatArray:
    extents = np.zeros(3)
    found = np.linalg.svd(np.sqrt(shares)[:, None] * centred, compute_uv=False)
    extents[: len(found)] = found
    return extents
