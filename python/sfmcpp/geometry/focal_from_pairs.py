"""Common focal length of photos, from their pairwise fundamental matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry._poselib import RansacOptions, refined_fundamental, refined_relative_camera
from sfmcpp.geometry.epipolar import camera_of_fundamental, fundamental_matrix, sampson_errors_px
from sfmcpp.geometry.parabola import parabola_minimum
from sfmcpp.geometry.pinhole import to_normalised
from sfmcpp.geometry.two_view_matrices import fundamental_linear
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray, finite_array
from sfmcpp.model.checks import require_seed
from sfmcpp.model.threads import on_threads, thread_count

# Focal lengths that are tried, in larger sides of the image: from a fisheye to a long lens.
_SHORTEST, _LONGEST, _NUM_COARSE, _NUM_FINE = 0.35, 4.5, 20, 7
# Pairs with most matches, and matches of each, that are looked at: more cost time and change little.
MOST_PAIRS, _MOST_MATCHES, _LEAST_MATCHES = 40, 200, 30
# Errors beyond this many standard deviations lose weight.
_LOSS_SCALE = 2.0
_LEAST_SIGMA_PX = 1e-3
# No pair may object to a focal length more than this for each of its matches: some are wrong as a whole.
_LARGEST_OBJECTION = 0.2
# Beyond this factor of the best focal length the sum of all objections must have grown by so much.
_CLEARLY_OTHER, _CLEAR_GROWTH = 1.5, 10.0


@dataclass(frozen=True)
class _Pair:
    """Matches of one pair, its fundamental matrix and the scale of its loss [px]."""

    pixels_1: FloatArray
    pixels_2: FloatArray
    fundamental: FloatArray
    scale_px: float


@checked()
def focal_from_pairs(
    pairs: Sequence[tuple[ArrayLike, ArrayLike]], size: tuple[int, int], *, seed: int = 0
) -> float | None:
    """Guess the focal length of photos of one camera with square pixels, its principal point at the centre.

    For each focal length of a grid, each pair's relative pose is fitted to its matches, from where its
    fundamental matrix leads. The loss that this leaves above the pair's least, bounded so that no wrong pair
    decides, is the pair's objection; the focal length with the least sum is refined on a finer grid. Pairs
    that say nothing of the focal length (parallel axes, cameras that look at one point from equal distances)
    object to nothing.

    Parameters
    ----------
    pairs : sequence of ((N, 2), (N, 2)) float64
        Pixels in both photos of matches that agree with a fundamental matrix [px], as the inliers of a
        ``"general"`` :func:`two_view_geometry`. The 40 with most matches are used; with fewer than 30, none.
    size : tuple of int
        Width and height of all photos [px].
    seed : int
        Chooses 200 of more matches of a pair. Same seed, same result.

    Returns
    -------
    float or None
        Focal length [px], a start for an adjustment; None where the pairs leave it open within a factor of
        1.5, or between 0.35 and 4.5 times the larger side.

    Raises
    ------
    InvalidArgument
        If an array has another shape or is not finite, or the size is not positive.
    ModuleNotFoundError
        If PoseLib is not installed (extra ``vision``).
    """
    require_seed(seed)
    if min(size) <= 0:
        raise InvalidArgument(f"size = {size}: width and height must be positive")
    chosen = _largest_centred_pairs(pairs, np.asarray(size, dtype=np.float64) / 2, seed)
    if not chosen:
        return None
    coarse = max(size) * np.geomspace(_SHORTEST, _LONGEST, _NUM_COARSE)
    losses = _losses(chosen, coarse)
    objections = _summed_losses(chosen, losses)
    best = int(np.argmin(objections))
    if not _is_clear_minimum(coarse, objections, best):
        return None
    fine = np.geomspace(coarse[best - 1], coarse[best + 1], _NUM_FINE)
    return _focal_between(np.log(fine), _summed_losses(chosen, _losses(chosen, fine)))


def _largest_centred_pairs(
    pairs: Sequence[tuple[ArrayLike, ArrayLike]], centre: FloatArray, seed: int
) -> list[_Pair]:
    """The pairs with most matches, counted from the centre of the image."""
    checked = []
    for k, (a, b) in enumerate(pairs):
        pixels_1 = finite_array(f"pairs[{k}][0]", a, (-1, 2))
        checked.append((pixels_1 - centre, finite_array(f"pairs[{k}][1]", b, (len(pixels_1), 2)) - centre))
    most = sorted((p for p in checked if len(p[0]) >= _LEAST_MATCHES), key=lambda p: -len(p[0]))
    rng = np.random.default_rng(seed)
    found = (_with_fundamental(*pair, rng) for pair in most[:MOST_PAIRS])
    return [pair for pair in found if pair is not None]


def _with_fundamental(pixels_1: FloatArray, pixels_2: FloatArray, rng: np.random.Generator) -> _Pair | None:
    """The pair; None where no fundamental matrix tells anything of its matches, as of those at one place."""
    some = rng.permutation(len(pixels_1))[:_MOST_MATCHES]
    first, second = pixels_1[some], pixels_2[some]
    start = fundamental_linear(first, second)
    scale = _scale_px(sampson_errors_px(start, first, second))
    if not np.isfinite(scale):
        return None
    matrix = refined_fundamental(first, second, start, _options(scale))
    scale = _scale_px(sampson_errors_px(matrix, first, second))
    return _Pair(first, second, matrix, scale) if np.isfinite(scale) else None


def _scale_px(errors_px: FloatArray) -> float:
    # The median of |e| is 0.6745 σ for Gaussian noise.
    return max(_LOSS_SCALE * float(np.median(errors_px)) / 0.6745, _LEAST_SIGMA_PX)


def _options(scale_px: float) -> RansacOptions:
    return RansacOptions(scale_px, 0.5, 1, 0)


def _losses(pairs: list[_Pair], focals: FloatArray) -> FloatArray:
    """(P, K) Cauchy loss that each pair is left with at each focal length."""
    return np.array(
        list(on_threads(lambda pair: [_loss(pair, focal) for focal in focals], pairs, thread_count()))
    )


def _loss(pair: _Pair, focal: float) -> float:
    row = np.array([focal, 1.0, 0.0, 0.0, 0.0])
    pixels = pair.pixels_1, pair.pixels_2
    normalised = [to_normalised(p, row) for p in pixels]
    start = camera_of_fundamental(pair.fundamental, row, row, normalised[0], normalised[1])
    camera = refined_relative_camera(*pixels, row, row, start, _options(pair.scale_px))
    errors = sampson_errors_px(fundamental_matrix(np.eye(3, 4), camera, row, row), *pixels)
    return float(np.log1p((errors / pair.scale_px) ** 2).sum())


def _summed_losses(pairs: list[_Pair], losses: FloatArray) -> FloatArray:
    """(K,) sums over the pairs of their bounded losses above their least."""
    bounds = _LARGEST_OBJECTION * np.array([len(pair.pixels_1) for pair in pairs])
    above = losses - losses.min(axis=1, keepdims=True)
    return np.asarray(np.minimum(above, bounds[:, None]).sum(axis=0))


def _is_clear_minimum(focals: FloatArray, objections: FloatArray, best: int) -> bool:
    """Whether the best focal length is inside the grid, and clearly better than any far from it."""
    if best in (0, len(focals) - 1):
        return False
    other = np.abs(np.log(focals / focals[best])) >= np.log(_CLEARLY_OTHER)
    return bool((objections[other] >= objections[best] + _CLEAR_GROWTH).all())


def _focal_between(log_focals: FloatArray, objections: FloatArray) -> float:
    """Focal length at the lowest point of the parabola through the least value and its neighbours."""
    best = min(max(int(np.argmin(objections)), 1), len(objections) - 2)
    shift, _ = parabola_minimum(*objections[best - 1 : best + 2])
    step = log_focals[1] - log_focals[0]
    return float(np.exp(log_focals[best] + step * np.clip(shift, -1, 1)))
