"""Statistics of weights from the linear model: redundancies, likelihoods, left-out errors.

With r the residuals of the images and e those of group g, all over their standard deviations, a group's
redundancy is ``n_g − tr(K_g)``, with the hat matrix ``K_g = w G_g H⁻¹ G_gᵀ``: its share of the degrees of
freedom (Förstner; Helmert's variance components). The redundancies of images and groups add up to the degrees
of freedom of the whole adjustment.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from sfmcpp.ba.linear_results import LinearStep
from sfmcpp.ba.linearize import LinearModel
from sfmcpp.ba.variance_factor import InfluenceSums
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.parabola import parabola_minimum
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.weighting.fits import LEAST_NOISE, WeightFit, WeightFits, squared_residuals

# Above so many free parameters of cameras hat matrices are not formed; some members stand for all.
MAX_COLUMNS = 4000
_SAMPLED_MEMBERS = 60
# The linear model at one optimum is used for weights up to this factor above or below its own.
_REACH = 100.0
_FACTORS = np.geomspace(1 / _REACH, _REACH, 401)
# A prior proportional to a standard deviation counts as one measurement less.
_PRIOR = 1
# Sampled redundancies below this count as this.
_REDUNDANCY_FLOOR = 1e-3
_TINY = float(np.finfo(float).tiny)
# Errors of rotation matrices and of images have more rows than degrees of freedom; the eigenvalues of the hat
# matrix for the surplus rows are zero up to rounding, which is below this.
_LEAST_SHARE = 1e-12
# Fewest views of a point for its observations to be left out: two more must be left to triangulate it.
_LEAST_VIEWS = 3
# Of a metric world: position, rotation and scale.
_GAUGE_FREEDOMS = 7


@dataclass(frozen=True)
class Redundancy:
    """Degrees of freedom of a fit, by what they are due to.

    Attributes
    ----------
    images : float
        Redundancy of the observations.
    groups : (k,) float64
        Redundancy of each group.
    """

    images: float
    groups: FloatArray


def redundancy_of_images(model: LinearModel) -> int:
    """Degrees of freedom that images of metric cameras have beside nothing else.

    They do not determine where the world is: columns of that explain nothing of them, unless the gauge holds
    them (baselines of rigs tell the scale, one of the seven).
    """
    held = int(np.count_nonzero(model.camera_columns[np.unique(model.camera_index), :6] < 0))
    return 2 * len(model.residuals) - int(model.num_columns) + max(_GAUGE_FREEDOMS - held, 0)


class FitStatistics:
    """Statistics of the linear model at a state near the optimum, taken at the model's own minimum.

    Where the cameras have more than `MAX_COLUMNS` free parameters, it is taken at the state itself, and hat
    matrices are known by their traces alone, estimated from some members.

    Parameters
    ----------
    fits : WeightFits
        Problem, groups and loss.
    problem : Problem
        The state.
    weights : (k,) float64
        Weight of each group.
    settled : bool
        Whether the minimiser has brought the state to the optimum: then the model takes no step, because an
        undamped one would be large along directions that the data hardly determine.

    Attributes
    ----------
    linear : LinearModel
        The model.
    problem, weights : Problem, (k,) float64
        As given.
    """

    def __init__(
        self, fits: WeightFits, problem: Problem, weights: FloatArray, settled: bool = False
    ) -> None:
        self._fits, self.problem, self.weights, self._settled = fits, problem, weights, settled
        self.linear = fits.linearize(problem, weights)

    @property
    def too_large(self) -> bool:
        """Whether the problem has too many columns."""
        return self.linear.num_camera_columns > MAX_COLUMNS

    def require_small(self) -> None:
        """Raise InvalidArgument if the problem has too many columns."""
        if self.too_large:
            raise InvalidArgument(
                f"problem: {self.linear.num_camera_columns} free parameters of cameras, must be at most "
                f"{MAX_COLUMNS} for a weight chosen by 'loo-approx'"
            )

    @cached_property
    def step(self) -> LinearStep:
        """The minimum of the model; the state itself if it is one, or if the problem is too large."""
        if self._settled or self.too_large:
            return LinearStep(self.problem, [rows.errors for rows in self.linear.groups], 0.0)
        return self.linear.step()

    @property
    def errors(self) -> list[FloatArray]:
        """(R,) errors of each group there."""
        return self.step.errors

    @cached_property
    def hats(self) -> list[FloatArray]:
        """(R, R) hat matrix of each group, over its rows; zero if the problem is too large."""
        if self.too_large:
            sizes = [len(rows.errors) for rows in self.linear.groups]
            return [np.broadcast_to(0.0, (size, size)) for size in sizes]
        return [self.linear.hat_matrix(k) for k in range(len(self.weights))]

    @cached_property
    def redundancy(self) -> Redundancy:
        """Redundancy of the images and of each group."""
        used = np.array([self._used(k) for k in range(len(self.weights))])
        measured = np.array([self._fits.measurements(k) for k in range(len(used))])
        if self.too_large:
            return Redundancy(redundancy_of_images(self.linear), measured - used)
        images = 2 * len(self.linear.residuals) - (self.linear.num_determined - used.sum())
        return Redundancy(images, measured - used)

    def _used(self, k: int) -> float:
        """How many numbers of a group the fit uses up: the trace of its hat matrix."""
        if not self.too_large:
            return float(np.trace(self.hats[k]))
        rows = self.linear.groups[k]
        members = np.unique(rows.member)
        some = members[np.unique(np.linspace(0, len(members) - 1, _SAMPLED_MEMBERS).astype(np.intp))]
        derivatives = rows.jacobian()[np.isin(rows.member, some)]
        columns = np.unique(derivatives.indices)
        if not len(columns):
            return 0.0
        derivatives = derivatives[:, columns].toarray()
        products = derivatives @ self.linear.covariance_of_columns(columns) * derivatives
        return float(self.weights[k] * products.sum()) * len(members) / len(some)

    @cached_property
    def squared(self) -> FloatArray:
        """(M,) squared residuals there."""
        return squared_residuals(self.step.problem)

    @property
    def decreases(self) -> tuple[float, float]:
        """Decrease of Σ ρ + Σ w m ε by the step to the model's minimum: the actual one, the predicted one."""
        images = float(self._fits.loss_terms(self.squared)[0].sum())
        there = images + float(self.weights @ self._fits.squared_errors(self.step.problem))
        return 2 * self.linear.cost - there, 2 * self.step.decrease

    @cached_property
    def fit(self) -> WeightFit:
        """The minimum of the model as a fit."""
        problem, errors = self.step.problem, np.array([float(e @ e) for e in self.errors])
        images = 2 * (self.linear.cost - self.step.decrease) - float(self.weights @ errors)
        return WeightFit(problem, max(images, 0.0), errors, self._fits.inliers(self.squared))

    @cached_property
    def image_sigma(self) -> float:
        """Standard deviation of the images in units of the declared one.

        Under a robust loss it is that of Huber's asymptotic variance: the mean square of the influence ψ over
        the mean of its slope, for the weight of a cost with that slope.
        """
        free = redundancy_of_images(self.linear) if self.too_large else self.redundancy.images
        sums = InfluenceSums.of(self.squared, *self._fits.loss_terms(self.squared)[1:])
        return max(math.sqrt(sums.variance_in_cost(sums.count - free)), LEAST_NOISE)

    def best_factor(self, k: int) -> float:
        """Factor by which the weight of group k maximises the restricted likelihood, others held.

        In the linear model, with a = eigenvalues of K and ẽ the weighted errors in its eigenvectors, at the
        weight τ w the errors are ``ẽ / (1 + (τ − 1) a)``; minus twice the logarithm of the restricted
        likelihood (Patterson and Thompson 1971) is ``(V + τ E) / s² + log det H − n log τ``. Where it is
        smallest, ``τ E / s²`` equals the redundancy: Helmert's estimate. With a small redundancy that may be
        at σ = 0, which a prior proportional to σ excludes (Chung et al., "A nondegenerate penalized
        likelihood estimator for variance parameters in multilevel models", 2013). Of too large problems it
        is Helmert's estimate with the redundancy at w.

        Parameters
        ----------
        k : int
            Number of the group.

        Returns
        -------
        float
            τ, between 1/100 and 100.
        """
        if self.too_large:
            left = max(self.redundancy.groups[k] - _PRIOR, _REDUNDANCY_FLOOR)
            own = self.weights[k] * float(self.errors[k] @ self.errors[k])
            return float(np.clip(left * self.image_sigma**2 / max(own, _TINY), 1 / _REACH, _REACH))
        share, vectors = self.linear.hat_spectrum(k)
        share = np.clip(np.where(share < _LEAST_SHARE, 0.0, share), 0.0, 1.0)
        errors = math.sqrt(self.weights[k]) * (vectors.T @ self.errors[k])
        step = _FACTORS[:, None] - 1
        grown = 1 + step * share
        squared = errors**2
        images = (share * step * (2 / grown + (1 - share) * step / grown**2)) @ squared
        own = _FACTORS * ((1 / grown**2) @ squared)
        score = (images + own) / self.image_sigma**2
        score += np.log(grown).sum(axis=1) - self._num_measurements(k) * np.log(_FACTORS)
        return _lowest_factor(score)

    def _num_measurements(self, k: int) -> int:
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
        cost = self.fit.images + float(self.weights @ self.fit.errors)
        measured = sum(self._num_measurements(k) * math.log(self.weights[k]) for k in chosen)
        return cost, self.linear.log_determinant - measured

    def left_out_error(self) -> float:
        """Mean loss of the error of each observation as predicted from all others, in closed form.

        With the leverage ``H_o = J_o H⁻¹ J_oᵀ`` (2×2) the error is ``(I − H_o)⁻¹ r_o``, one Gauss–Newton step
        without the observation (Allen's PRESS). Observations of points with fewer than three views are not
        counted: one view does not determine a point from which to predict the other. InvalidArgument if all
        have fewer.
        """
        self.require_small()
        views = np.bincount(self.problem.point_index, minlength=self.problem.num_points)
        judged = (views >= _LEAST_VIEWS)[self.problem.point_index]
        if not judged.any():
            raise InvalidArgument(
                f"weight = 'loo-approx': no point has {_LEAST_VIEWS} observations, one to predict from others"
            )
        without = np.eye(2) - self.linear.leverages()[judged]
        predicted = np.linalg.solve(without, self.linear.residuals[judged][:, :, None])
        return float(self._fits.left_out_loss((predicted**2).sum(axis=(1, 2))).mean())


def _lowest_factor(score: FloatArray) -> float:
    best = int(np.argmin(score))
    if best in (0, len(score) - 1):
        return float(_FACTORS[best])
    shift, _ = parabola_minimum(*score[best - 1 : best + 2])
    return float(_FACTORS[best] * (_FACTORS[1] / _FACTORS[0]) ** shift)
