"""Similarities of space, and the one that fits pairs of points or poses best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.point_moments import PointMoments
from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.model.arrays import ANY, FloatArray, finite_array
from sfmcpp.model.checks import is_rotation, require_positive

_ROTATION_TOLERANCE = 1e-6
# Thinnest extent relative to the longest one that is more than rounding.
_THINNEST = 1e-7


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

    def __post_init__(self) -> None:
        require_positive("scale", self.scale)
        object.__setattr__(self, "rotation", finite_array("rotation", self.rotation, (3, 3)))
        object.__setattr__(self, "translation", finite_array("translation", self.translation, (3,)))
        if not is_rotation(self.rotation, _ROTATION_TOLERANCE):
            raise InvalidArgument("rotation: must be orthonormal and right-handed")

    @classmethod
    def identity(cls) -> Similarity:
        """The map that changes nothing."""
        return cls(1.0, np.eye(3), np.zeros(3))

    def apply(self, points: FloatArray) -> FloatArray:
        """Images (…, 3) of points (…, 3): thesis eq. 5.17."""
        return np.asarray(self.scale * (points @ self.rotation.T) + self.translation)

    def apply_to_poses(self, poses: FloatArray) -> FloatArray:
        """Images (…, 3, 4) of poses ``[R | c]`` world_from_camera (…, 3, 4): thesis eq. 5.16.

        The rotation stays a rotation: what a camera sees does not depend on the scale.
        """
        rotations = self.rotation @ poses[..., :3]
        # Row by row: a pose must go to the same bits alone and among others.
        centres = self.apply(poses[..., None, :, 3])[..., 0, :]
        return np.concatenate([rotations, centres[..., None]], axis=-1)

    def inverse(self) -> Similarity:
        """The map back."""
        back = self.rotation.T
        return Similarity(1 / self.scale, back, -(back @ self.translation) / self.scale)

    def __matmul__(self, first: Similarity) -> Similarity:
        return Similarity(
            self.scale * first.scale, self.rotation @ first.rotation, self.apply(first.translation)
        )


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
        the points of either side lie on a line, about which no rotation is better than another.
    """
    moments = _moments(source, target, weights)
    _require_plane(moments)
    return _with_rotation(moments, nearest_rotation(moments.covariance), with_scale)


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
        if not extents[1] > _THINNEST * extents[0]:
            raise InvalidArgument(
                f"{name}: the points lie on a line, about which any rotation fits: must span a plane"
            )


def _require_movement(moments: PointMoments) -> None:
    for name, mean, variance in (
        ("source", moments.source_mean, moments.source_variance),
        ("target", moments.target_mean, moments.target_variance),
    ):
        if not np.sqrt(variance) > _THINNEST * np.linalg.norm(mean):
            raise InvalidArgument(f"{name}: all positions are the same, must differ")


def _with_rotation(moments: PointMoments, rotation: FloatArray, with_scale: bool) -> Similarity:
    scale = moments.scale(rotation) if with_scale else 1.0
    if not scale > 0:
        raise InvalidArgument("target: runs against source whatever the rotation, no positive scale fits")
    return Similarity(scale, rotation, moments.translation(rotation, scale))
