"""Chance agreement of matches with a model, numbers of random samples, and limits for what scatters.

Of N random matches, each agreeing with a given model with probability α, and a model through each sample of
s matches, about ``(N − s) C(N, k) C(k, s) α^(k − s)`` models with k inliers are expected (L. Moisan,
B. Stival, IJCV 2004). Inliers mean something where that is far below one.
"""

from __future__ import annotations

import math

import numpy as np

from sfmcpp.model.arrays import FloatArray

# Sampson errors are lengths in the joint space of two images: √2 of that in one of them.
_ONE_OF_TWO = math.sqrt(2.0)
# Matches that cover an area so small that half of all would agree with anything mean nothing.
_LARGEST_CHANCE = 0.5
# So many models of chance are expected at most: one false pair in a thousand.
_LOG_EXPECTED = math.log(1e-3)
# Standard deviation of Gaussian noise over the median of its absolute values.
SIGMA_OF_MEDIAN = 1.4826
# Median length of a normal deviate of two coordinates, σ = 1.
MEDIAN_LENGTH = math.sqrt(2 * math.log(2.0))
# A right number may be beyond a limit so rarely, where it is few numbers that tell how they scatter.
_RARELY = 3e-4


def least_significant(count: int, sample_size: int, chance: float) -> int:
    """Fewest inliers of `count` matches that do not agree by chance; more than `count` where none do."""
    if count <= sample_size:
        return count + 1
    log_factorials = np.concatenate([[0.0], np.cumsum(np.log(np.arange(1, count + 1)))])
    k = np.arange(sample_size + 1, count + 1)
    # ln C(N, k) + ln C(k, s) without the factorials of k, which cancel.
    choices = log_factorials[count] - log_factorials[count - k] - log_factorials[k - sample_size]
    choices -= log_factorials[sample_size]
    expected = math.log(count - sample_size) + choices + (k - sample_size) * math.log(chance)
    by_chance = np.flatnonzero(expected >= _LOG_EXPECTED)
    return int(k[by_chance[-1]]) + 1 if len(by_chance) else sample_size + 1


def chance_near_line(pixels_1: FloatArray, pixels_2: FloatArray, threshold_px: float) -> float:
    """Probability that a random match has a Sampson error of an epipolar geometry below the threshold."""
    chances = []
    for pixels in (pixels_1, pixels_2):
        width, height = _extent(pixels)
        chances.append(2 * _ONE_OF_TWO * threshold_px * math.hypot(width, height) / (width * height))
    return max(chances) if max(chances) < _LARGEST_CHANCE else 1.0


def chance_near_point(pixels_1: FloatArray, pixels_2: FloatArray, threshold_px: float) -> float:
    """Probability that a random match has a Sampson error of a homography below the threshold."""
    areas = [math.prod(_extent(pixels)) for pixels in (pixels_1, pixels_2)]
    chance = math.pi * (_ONE_OF_TWO * threshold_px) ** 2 / min(areas)
    return chance if chance < _LARGEST_CHANCE else 1.0


def samples_needed(ratio: float, sample_size: int, confidence: float, most: int) -> int:
    """Samples after which one without outliers was drawn with that confidence; no more than `most`."""
    good = min(ratio, 1.0) ** sample_size
    if good >= confidence:
        return 1
    needed = math.log1p(-confidence) / math.log1p(-good) if good > 0 else math.inf
    return max(1, math.ceil(min(needed, most)))


def students_limit(redundancy: float) -> float:
    """Standard deviations that a right number is off at most, these being known from so many others.

    From few, as of three positions that happen to fit, a standard deviation is often far too small: 58 of
    two, 6.1 of eight, 3.6 of all.
    """
    from scipy.special import stdtrit

    return -float(stdtrit(redundancy, _RARELY / 2))


def mad_sigma(centred: FloatArray) -> float:
    """Robust standard deviation of numbers that scatter about zero, from their median absolute value."""
    return SIGMA_OF_MEDIAN * float(np.median(np.abs(centred)))


def _extent(pixels: FloatArray) -> tuple[float, float]:
    """Width and height [px] of what the matches cover, at least one pixel each."""
    if len(pixels) == 0:
        return 1.0, 1.0
    width, height = np.maximum(np.ptp(pixels, axis=0), 1.0)
    return float(width), float(height)
