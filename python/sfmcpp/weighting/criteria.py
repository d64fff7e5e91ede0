"""Criteria that score weights, the lower the better (thesis §2.4 and §5.2.3).

The trade-off criteria look at the curve of two objectives over the logarithm of the weight: ρ, what the fit
minimises beside the selected constraint, and ν, the mean squared error of that constraint. At an optimum of
``ρ + λ² ν`` the derivatives are tied by ``ρ′ = −λ² ν′``, so that ν′ is all the criteria need, and no second
derivative is ever taken (Hansen, "The L-curve and its use in the numerical treatment of inverse problems",
2001, §5). Differences of ρ itself drown in rounding at small weights, where ρ moves with λ⁴: the thesis
reports a chaotic zone there, and that its L-curve chooses in it.

All three take the weights λ (W,), not negative and increasing; ρ and ν (W,) at each; and dν / d log λ (W,),
None for differences. They return (W,) scores, infinite for λ = 0, and raise InvalidArgument if the arrays do
not fit together or the weights do not increase.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, BoolArray, FloatArray, IndexArray, finite_array

# Width of the running median (thesis eqs 5.10–5.11), and share of inliers to keep (§5.2.3.2).
MEDIAN_WIDTH = 11
_INLIER_SHARE = 0.9
# Scores that differ by less than this share are the same.
_TIE = 1e-12


@checked(weights=(ANY,), rest=(ANY,), constraint=(ANY,), slope=(ANY,))
def l_curve_scores(
    weights: FloatArray, rest: FloatArray, constraint: FloatArray, slope: FloatArray | None = None
) -> FloatArray:
    """Minus the curvature of ``(log √ρ, log √ν)``, twice that of ``(log ρ, log ν)`` (thesis eqs 2.53–2.54).

    Parameters
    ----------
    weights, rest, constraint, slope : (W,) float64
        λ, ρ, ν and dν / d log λ.

    Returns
    -------
    (W,) float64
        −2κ, κ the curvature of ``(log ρ, log ν)``; infinite where the curve stands still or an objective is
        zero, and for λ = 0.
    """
    rho, nu, nu_slope = _checked_curve(weights, rest, constraint, slope)
    defined = (weights > 0) & (rho > 0) & (nu > 0) & (nu_slope < 0)
    scores = np.full(len(weights), np.inf)
    w2, r, n, d = (x[defined] for x in (weights**2, rho, nu, nu_slope))
    bend = 2 + d / n + w2 * d / r
    scores[defined] = 2 * w2 * (r * n) ** 2 * bend / (d * ((w2 * n) ** 2 + r**2) ** 1.5)
    return scores


@checked(weights=(ANY,), rest=(ANY,), constraint=(ANY,), slope=(ANY,))
def scaled_l_curve_scores(
    weights: FloatArray, rest: FloatArray, constraint: FloatArray, slope: FloatArray | None = None
) -> FloatArray:
    """Minus the curvature of ``(ρ̄, ν̄)``, the objectives scaled to [0, 1] over the grid.

    Not in the thesis. Where the constraint hardly moves the error of the images, as in most fits of a pose,
    the curve of the logarithms is a vertical line without a corner; this one has a corner at any scale.

    Parameters
    ----------
    weights, rest, constraint, slope : (W,) float64
        λ, ρ, ν and dν / d log λ.

    Returns
    -------
    (W,) float64
        Minus the curvature; infinite where the curve stands still, and for λ = 0.
    """
    rho, nu, nu_slope = _checked_curve(weights, rest, constraint, slope)
    height, width = np.ptp(nu), np.ptp(rho)
    defined = (weights > 0) & (nu_slope < 0) & (height > 0) & (width > 0)
    scores = np.full(len(weights), np.inf)
    w2, d = weights[defined] ** 2, nu_slope[defined]
    scores[defined] = 2 * w2 * (width * height) ** 2 / (d * ((w2 * height) ** 2 + width**2) ** 1.5)
    return scores


@checked(weights=(ANY,), rest=(ANY,), constraint=(ANY,), slope=(ANY,))
def ltn_scores(
    weights: FloatArray, rest: FloatArray, constraint: FloatArray, slope: FloatArray | None = None
) -> FloatArray:
    """Squared norm of the tangent ``(ρ̄′, ν̄′)`` of the objectives scaled to [0, 1] (thesis eq. 2.55).

    Parameters
    ----------
    weights, rest, constraint, slope : (W,) float64
        λ, ρ, ν and dν / d log λ.

    Returns
    -------
    (W,) float64
        The scores; zero for an objective that stands still, infinite for λ = 0.
    """
    rho, nu, nu_slope = _checked_curve(weights, rest, constraint, slope)
    scores = _scaled_derivative(weights**2 * nu_slope, rho) ** 2 + _scaled_derivative(nu_slope, nu) ** 2
    return np.where(weights > 0, scores, np.inf)


@checked(scores=(ANY,))
def running_median(scores: FloatArray, width: int = MEDIAN_WIDTH) -> FloatArray:
    """Median of each score and its neighbours (thesis eqs 5.10–5.11).

    Parameters
    ----------
    scores : (W,) float64
        Scores in the order of the weights.
    width : int
        Odd number of scores in a median.

    Returns
    -------
    (W,) float64
        The medians; infinite where neighbours are missing at an end.

    Raises
    ------
    InvalidArgument
        If `width` is not odd and positive, or there are fewer scores.
    """
    if width < 1 or width % 2 == 0:
        raise InvalidArgument(f"width = {width}: must be odd and positive")
    if len(scores) < width:
        raise InvalidArgument(f"scores: {len(scores)}, must be at least {width} for a running median")
    smooth = np.full(len(scores), np.inf)
    half = width // 2
    windows = np.lib.stride_tricks.sliding_window_view(scores, width)
    smooth[half : len(scores) - half] = np.median(windows, axis=1)
    return smooth


@checked()
def admissible_weights(inliers: IndexArray, initial_inliers: int, share: float = _INLIER_SHARE) -> BoolArray:
    """Which weights keep enough inliers (thesis §5.2.3.2, the check of stability).

    Parameters
    ----------
    inliers : (W,) int
        Points within 2 px after each constrained fit.
    initial_inliers : int
        The same after the fit without constraint.
    share : float
        Share of the initial inliers to keep.

    Returns
    -------
    (W,) bool
        Whether each weight may be chosen.
    """
    return np.asarray(inliers >= share * initial_inliers)


@checked(scores=("n",), admissible=("n",))
def lowest(scores: FloatArray, admissible: BoolArray) -> int:
    """Index of the smallest score of an admissible weight; of equal scores the first; 0 if there is none.

    Parameters
    ----------
    scores : (W,) float64
        Scores in the order of the weights; those not finite are never chosen.
    admissible : (W,) bool
        Which may be chosen.

    Returns
    -------
    int
        The index.
    """
    candidates = np.where((admissible != 0) & np.isfinite(scores), scores, np.inf)
    best = candidates.min(initial=np.inf)
    if not np.isfinite(best):
        return 0
    return int(np.flatnonzero(candidates <= best + _TIE * abs(best))[0])


@checked(scores=("n",), admissible=("n",))
def lowest_valley(scores: FloatArray, admissible: BoolArray) -> int:
    """Index of the smallest score between higher ones; the smallest of all if no valley is there.

    A trade-off curve stands still at both ends of the grid, where the weight has no influence any more or
    full influence: there the criteria are small without telling anything.

    Parameters
    ----------
    scores : (W,) float64
        Scores in the order of the weights; those not finite are never chosen.
    admissible : (W,) bool
        Which may be chosen.

    Returns
    -------
    int
        The index; 0 if no score can be chosen.
    """
    usable = np.isfinite(scores)
    left = np.maximum.accumulate(np.where(usable, scores, -np.inf))
    right = np.maximum.accumulate(np.where(usable, scores, -np.inf)[::-1])[::-1]
    valley = usable & (admissible != 0) & _is_local_minimum(scores) & (scores < left) & (scores < right)
    return lowest(scores, valley if valley.any() else admissible)


def _is_local_minimum(scores: FloatArray) -> BoolArray:
    padded = np.concatenate([[np.inf], scores, [np.inf]])
    return np.asarray((scores <= padded[:-2]) & (scores <= padded[2:]))


def _checked_curve(
    weights: FloatArray, rest: FloatArray, constraint: FloatArray, slope: FloatArray | None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """ρ, ν and dν / d log λ, checked."""
    count = len(finite_array("weights", weights, (ANY,)))
    if not count or weights[0] < 0 or not (np.diff(weights) > 0).all():
        raise InvalidArgument("weights: must be not negative and increase strictly")
    rho = finite_array("rest", rest, (count,))
    nu = finite_array("constraint", constraint, (count,))
    if slope is not None:
        return rho, nu, finite_array("slope", slope, (count,))
    derivative = np.zeros(count)
    positive = weights > 0
    if np.count_nonzero(positive) > 1:
        derivative[positive] = np.gradient(nu[positive], np.log(weights[positive]))
    return rho, nu, derivative


def _scaled_derivative(derivative: FloatArray, values: FloatArray) -> FloatArray:
    """Derivative of the values scaled to [0, 1]; zero if they are all equal."""
    extent = np.ptp(values)
    return derivative / extent if extent > 0 else np.zeros_like(derivative)
