"""The robust losses of the core over arrays of squared residuals."""

from __future__ import annotations

import numpy as np

from sfmcpp.ba.options import SolveOptions
from sfmcpp.model.arrays import FloatArray


def rho(options: SolveOptions, squared: FloatArray) -> FloatArray:
    """ρ(s) of squared residuals s = ‖r‖².

    Parameters
    ----------
    options : SolveOptions
        Names the loss; its scale must be a number.
    squared : (...) float64
        Squared residuals.

    Returns
    -------
    (...) float64
        ρ, of slope one at zero.
    """
    scale = float(options.loss_scale_px)
    if options.loss == "huber":
        return np.where(squared <= scale**2, squared, 2 * scale * np.sqrt(squared) - scale**2)
    if options.loss == "cauchy":
        return np.asarray(scale**2 * np.log1p(squared / scale**2))
    return tukey(squared, scale) if options.loss == "tukey" else squared


def tukey(squared: FloatArray, scale: float) -> FloatArray:
    """Tukey's ρ of squared residuals: from `scale` on, all count the same."""
    return np.asarray(scale**2 / 3 * (1 - np.clip(1 - squared / scale**2, 0, None) ** 3))


def rho_slope(options: SolveOptions, squared: FloatArray) -> FloatArray:
    """ρ′(s): how much an observation counts in the normal equations.

    Parameters
    ----------
    options : SolveOptions
        Names the loss; its scale must be a number.
    squared : (...) float64
        Squared residuals.

    Returns
    -------
    (...) float64
        From one, of an inlier, down to zero.
    """
    c2 = float(options.loss_scale_px) ** 2
    if options.loss == "huber":
        return np.sqrt(c2 / np.maximum(squared, c2))
    if options.loss == "cauchy":
        return np.asarray(1 / (1 + squared / c2))
    if options.loss == "tukey":
        return np.asarray(np.clip(1 - squared / c2, 0, None) ** 2)
    return np.ones_like(squared)


def influence_slope(options: SolveOptions, squared: FloatArray) -> FloatArray:
    """``d(s ρ′(s)) / ds``: half the divergence of the influence ``ψ = ρ′ r`` of an observation.

    Parameters
    ----------
    options : SolveOptions
        Names the loss; its scale must be a number.
    squared : (...) float64
        Squared residuals.

    Returns
    -------
    (...) float64
        One for an inlier; negative where a loss turns observations down.
    """
    share = squared / float(options.loss_scale_px) ** 2
    if options.loss == "huber":
        return np.where(share <= 1, 1.0, 0.5 / np.sqrt(np.maximum(share, 1.0)))
    if options.loss == "cauchy":
        return np.asarray(1 / (1 + share) ** 2)
    if options.loss == "tukey":
        return np.where(share < 1, (1 - share) * (1 - 3 * share), 0.0)
    return np.ones_like(squared)
