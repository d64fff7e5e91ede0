"""Robust selection of the pairs of points that agree on one similarity."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import combinations
from math import comb

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.significance import SIGMA_OF_MEDIAN, students_limit
from sfmcpp.geometry.similarity import fit_similarity
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import BoolArray, FloatArray

_MAX_SAMPLES = 1000
_REFITS = 5
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
    for rows in _samples(len(source), seed):
        distances = _distances(source, target, list(rows), with_scale)
        if distances is not None and (median := float(np.median(distances))) < least:
            best, least = _inlier_mask(distances, target), median
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


def _samples(count: int, seed: int) -> Iterator[tuple[int, ...]]:
    if comb(count, 3) <= _MAX_SAMPLES:
        yield from combinations(range(count), 3)
        return
    rng = np.random.default_rng(seed)
    for _ in range(_MAX_SAMPLES):
        yield tuple(rng.choice(count, 3, replace=False).tolist())


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
