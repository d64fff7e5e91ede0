"""Pairs of points, boiled down to what every least-squares alignment of them needs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arrays import ANY, FloatArray, finite_array


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
