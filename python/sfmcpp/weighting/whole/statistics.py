"""What the normal equations at an optimum tell of the weights: redundancies, likelihoods, left-out errors.

With r the residuals of the images and e those of group g, all over their standard deviations, a group's
redundancy is ``n_g − tr(K_g)``, with the hat matrix ``K_g = G_g H⁻¹ G_gᵀ``: how many of its numbers are not
used up by the fit (Förstner; Helmert's variance components). The redundancies of images and groups add up to
the degrees of freedom of the whole.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sfmcpp.model.arrays import FloatArray
from sfmcpp.weighting.whole.constraint_rows import ConstraintRows, constraint_rows
from sfmcpp.weighting.whole.fits import WeightFit, WeightFits
from sfmcpp.weighting.whole.image_jacobian import image_jacobian
from sfmcpp.weighting.whole.reduced_system import ReducedSystem
from sfmcpp.weighting.whole.robust_loss import rho_slope

# Farthest weight, in factors, that the model at one optimum is believed for.
_REACH = 100.0
_FACTORS = np.geomspace(1 / _REACH, _REACH, 801)
# How many numbers the prior of a standard deviation takes.
_PRIOR = 1
# Rotation matrices and images have more rows than numbers: the others' share is rounding.
_LEAST_SHARE = 1e-12
# A point seen by two cameras is lost without one of them.
_LEAST_VIEWS = 3


@dataclass(frozen=True)
class Redundancy:
    """How a fit shares its degrees of freedom.

    Attributes
    ----------
    images : float
        Redundancy of the observations.
    groups : (k,) float64
        Redundancy of each group.
    """

    images: float
    groups: FloatArray


class FitStatistics:
    """The linear model at an optimum.

    Parameters
    ----------
    fits : WeightFits
        Problem, groups and loss.
    fit : WeightFit
        The optimum.
    weights : (k,) float64
        The weights it was fitted at.

    Attributes
    ----------
    hats : list of (R, R) float64
        Hat matrix K of each group, over its rows.
    redundancy : Redundancy
        Of the images and of each group.
    image_sigma : float
        Standard deviation of the images in units of the declared one.

    Raises
    ------
    InvalidArgument
        If there are too many columns for dense matrices.
    """

    def __init__(self, fits: WeightFits, fit: WeightFit, weights: FloatArray) -> None:
        self._fits, self._fit, self._weights = fits, fit, weights
        self._images = image_jacobian(fit.problem)
        self._squared = (self._images.residuals**2).sum(axis=1)
        self._slope = rho_slope(fits.options, self._squared)
        self._system = ReducedSystem(self._images, self._slope)
        columns = self._images.cameras
        self._groups = [constraint_rows(group, fit.problem, columns) for group in fits.groups]
        roots = [math.sqrt(w) for w in weights]
        rows = np.concatenate([r * g.jacobian for r, g in zip(roots, self._groups, strict=True)])
        inverse = self._system.inverse(rows)
        self._covariance = inverse.covariance
        self.hats = [self._hat(w, g) for w, g in zip(weights, self._groups, strict=True)]
        used = np.array([float(np.trace(hat)) for hat in self.hats])
        measured = np.array([fits.measurements(k) for k in range(len(self._groups))])
        images = 2 * len(self._squared) - (inverse.parameters - used.sum())
        self.redundancy = Redundancy(images, measured - used)
        self.image_sigma = fits.image_sigma(fit, images)
        self._log_determinant = inverse.log_determinant

    def _hat(self, weight: float, group: ConstraintRows) -> FloatArray:
        return np.asarray(weight * (group.jacobian @ self._covariance @ group.jacobian.T))

    def rows(self, k: int) -> ConstraintRows:
        """Errors and derivatives of group k, without its weight."""
        return self._groups[k]

    def best_factor(self, k: int) -> float:
        """Factor by which the weight of group k maximises the restricted likelihood, others held.

        In the linear model at this optimum, with a = eigenvalues of K and ẽ the weighted errors in its
        eigenvectors, at the weight τ w the errors are ``ẽ / (1 + (τ − 1) a)``; minus twice the logarithm of
        the restricted likelihood (Patterson and Thompson 1971) is ``(V + τ E) / s² + log det H − n log τ``.
        Where it is smallest, ``τ E / s²`` equals the redundancy: Helmert's estimate. With few numbers left
        that may well be at σ = 0; a prior proportional to σ, one number less, keeps it away (Chung et al., "A
        nondegenerate penalized likelihood estimator for variance parameters in multilevel models", 2013).

        Parameters
        ----------
        k : int
            Number of the group.

        Returns
        -------
        float
            τ, within two decades of one.
        """
        share, vectors = np.linalg.eigh(self.hats[k])
        share = np.clip(np.where(share < _LEAST_SHARE, 0.0, share), 0.0, 1.0)
        errors = math.sqrt(self._weights[k]) * (vectors.T @ self._groups[k].errors)
        step = _FACTORS[:, None] - 1
        grown = 1 + step * share
        squared = errors**2
        images = (share * step * (2 / grown + (1 - share) * step / grown**2)) @ squared
        own = _FACTORS * ((1 / grown**2) @ squared)
        score = (images + own) / self.image_sigma**2
        score += np.log(grown).sum(axis=1) - self._counted(k) * np.log(_FACTORS)
        return _lowest_factor(score)

    def _counted(self, k: int) -> int:
        return self._fits.measurements(k) - _PRIOR

    def likelihood_terms(self, chosen: Sequence[int]) -> tuple[float, float]:
        """Minus twice the logarithm of restricted likelihood and prior, up to a constant, in two parts.

        Parameters
        ----------
        chosen : sequence of int
            The groups whose weights are compared.

        Returns
        -------
        (float, float)
            The cost, to be divided by the variance of the images, and the rest.
        """
        cost = self._fit.images + float(self._weights @ self._fit.errors)
        measured = sum(self._counted(k) * math.log(self._weights[k]) for k in chosen)
        return cost, self._log_determinant - measured

    def left_out_error(self) -> float:
        """Mean loss of the errors with which all others predict each observation, in closed form.

        With the leverage ``H_o = J_o H⁻¹ J_oᵀ`` (2×2) the error is ``(I − H_o)⁻¹ r_o``, one Gauss–Newton step
        without the observation (Allen's PRESS). Observations of points with fewer than three views are left
        out: without one of them there is no point to predict from.
        """
        problem = self._fit.problem
        views = np.bincount(problem.point_index, minlength=problem.num_points)
        judged = (views >= _LEAST_VIEWS)[problem.point_index]
        without = np.eye(2) - self._system.leverages(self._covariance)[judged]
        predicted = np.linalg.solve(without, self._images.residuals[judged][:, :, None])
        return float(self._fits.left_out_loss((predicted**2).sum(axis=(1, 2))).mean())


def fit_statistics(fits: WeightFits, fit: WeightFit, weights: FloatArray) -> FitStatistics:
    """The linear model at an optimum; the latest is kept, the end of a search being what its report asks for.

    Parameters
    ----------
    fits : WeightFits
        Problem, groups and loss.
    fit : WeightFit
        The optimum.
    weights : (k,) float64
        The weights it was fitted at.

    Returns
    -------
    FitStatistics
        As made anew.

    Raises
    ------
    InvalidArgument
        If there are too many columns for dense matrices.
    """
    key = (id(fit), weights.tobytes())
    if key not in fits.latest:
        fits.latest.clear()
        fits.latest[key] = FitStatistics(fits, fit, weights)
    kept: FitStatistics = fits.latest[key]
    return kept


def _lowest_factor(score: FloatArray) -> float:
    best = int(np.argmin(score))
    if best in (0, len(score) - 1):
        return float(_FACTORS[best])
    before, here, after = score[best - 1 : best + 2]
    shift = 0.5 * (before - after) / (before - 2 * here + after)
    return float(_FACTORS[best] * (_FACTORS[1] / _FACTORS[0]) ** shift)
