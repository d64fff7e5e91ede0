"""Robust selection of the pairs of points that agree on one similarity."""

from __future__ import annotations

from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.significance import SIGMA_OF_MEDIAN, students_limit
from sfmcpp.geometry.similarity import SAME_PLACE, THINNEST_EXTENT, fit_similarity
from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray

_MAX_SAMPLES = 1000
_REFITS = 5
# Distances that are kept at a time, eight bytes each and several times over.
_MOST_DISTANCES = 500_000
# Scale from the least median: P. Rousseeuw and A. Leroy, "Robust Regression and Outlier Detection" (1987).
_INLIER_SIGMAS = 2.5
# Of so few pairs, the median distance is that of a fit to three: the best of ten says nothing of the others.
_FEW = 5
# Differences below this share of the extent are rounding, whatever the others are.
_ROUNDING = 1e-9


@checked(source=("n", 3), target=("n", 3))
def agreeing_pairs(
    source: FloatArray, target: FloatArray, *, with_scale: bool = True, seed: int = 0
) -> BoolArray:
    """Find the pairs that agree with the similarity of least median distance (Rousseeuw 1984).

    Fits of three pairs each, all of them or 1,000 drawn at random; the best is refitted to the pairs closer
    than 2.5 · 1.4826 (1 + 5 / (n − 3)) median distances. More than half of the pairs must be right. Of five,
    a pair is left out only if the scatter of the others makes it less likely than 3 in 10,000.

    Parameters
    ----------
    source, target : (n, 3) float64
        Pairs of points.
    with_scale : bool
        Whether the similarity may change the scale.
    seed : int
        Same seed, same pairs.

    Returns
    -------
    (n,) bool
        All true for fewer than five pairs, which cannot outvote one of them, or where no three pairs are off
        a line.
    """
    everything = np.ones(len(source), dtype=np.bool_)
    if len(source) < _FEW:
        return everything
    best, least = everything, np.inf
    samples = _samples(len(source), seed)
    for some in np.array_split(samples, -(-len(samples) * len(source) // _MOST_DISTANCES)):
        of_samples = _distances_under_samples(source, target, some, with_scale)
        medians = np.median(of_samples, axis=1)
        first = int(np.argmin(medians))
        if medians[first] < least:
            best, least = _inlier_mask(of_samples[first], target), float(medians[first])
    for _ in range(_REFITS):
        distances = _distances(source, target, np.flatnonzero(best).tolist(), with_scale)
        if distances is None or np.array_equal(closer := _inlier_mask(distances, target), best):
            break
        best = closer
    return _likely_of_few(source, target, best, with_scale) if len(source) == _FEW else best


def _likely_of_few(source: FloatArray, target: FloatArray, best: BoolArray, with_scale: bool) -> BoolArray:
    """The pairs that the scatter of the best ones allows, known as it is from few numbers."""
    for _ in range(_REFITS):
        distances = _distances(source, target, np.flatnonzero(best).tolist(), with_scale)
        redundancy = 3 * np.count_nonzero(best) - (7 if with_scale else 6)
        if distances is None or redundancy < 2:
            break
        # As `weighting.variance` estimates it, so that few numbers do not give next to nothing.
        sigma = np.sqrt(np.sum(distances[best] ** 2) / (redundancy - 1))
        limit = max(students_limit(redundancy) * np.sqrt(3) * sigma, _least_limit(target))
        if np.array_equal(likely := distances <= limit, best):
            break
        best = likely
    return best


def _samples(count: int, seed: int) -> NDArray[np.intp]:
    """Rows (s, 3) of the pairs of each sample."""
    if comb(count, 3) <= _MAX_SAMPLES:
        return np.array(list(combinations(range(count), 3)))
    rng = np.random.default_rng(seed)
    return np.stack([rng.choice(count, 3, replace=False) for _ in range(_MAX_SAMPLES)])


def _distances_under_samples(
    source: FloatArray, target: FloatArray, rows: NDArray[np.intp], with_scale: bool
) -> FloatArray:
    """Distances (s, n) of all pairs under the fit to each sample; infinite where it does not determine one.

    :func:`fit_similarity` of all samples at once: one by one they take fifty times as long.
    """
    x, y = source[rows], target[rows]
    means = x.mean(axis=1), y.mean(axis=1)
    x, y = x - means[0][:, None], y - means[1][:, None]
    determined = _spans_plane(x, means[0]) & _spans_plane(y, means[1])
    covariance = np.swapaxes(y, 1, 2) @ x
    rotation = nearest_rotation(covariance)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scale = (rotation * covariance).sum(axis=(1, 2)) / (x * x).sum(axis=(1, 2))
        scale = scale if with_scale else np.ones(len(rows))
        determined &= scale > 0
        linear = scale[:, None, None] * rotation
        translation = means[1] - np.einsum("sij,sj->si", linear, means[0])
        moved = source @ np.swapaxes(linear, 1, 2) + translation[:, None]
        distances = np.linalg.norm(moved - target, axis=2)
    return np.where(determined[:, None] & (distances < np.inf), distances, np.inf)


def _spans_plane(centred: FloatArray, means: FloatArray) -> BoolArray:
    """Whether each three points (s, 3, 3) about their means (s, 3) are off a line and at different places."""
    extents = np.linalg.svd(centred, compute_uv=False)
    spread = np.sqrt((extents**2).mean(axis=1))
    there = spread > SAME_PLACE * np.linalg.norm(means, axis=1)
    return np.asarray((extents[:, 1] > THINNEST_EXTENT * extents[:, 0]) & there)


def _distances(
    source: FloatArray, target: FloatArray, rows: list[int], with_scale: bool
) -> FloatArray | None:
    """Distances (n,) of all pairs under the fit to some of them; None where these do not determine one."""
    try:
        fitted = fit_similarity(source[rows], target[rows], with_scale=with_scale)
    except InvalidArgument:
        return None
    return np.asarray(np.linalg.norm(fitted.apply(source) - target, axis=1))


def _inlier_mask(distances: FloatArray, target: FloatArray) -> BoolArray:
    median = float(np.median(distances))
    sigma = SIGMA_OF_MEDIAN * (1 + 5 / max(len(distances) - 3, 1)) * median
    return np.asarray(distances <= max(_INLIER_SIGMAS * sigma, _least_limit(target)))


def _least_limit(target: FloatArray) -> float:
    return _ROUNDING * float(np.ptp(target, axis=0).max())
