"""Weights by variance component estimation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sfmcpp.model.arrays import FloatArray
from sfmcpp.weighting.fits import WeightFits
from sfmcpp.weighting.statistics import FitStatistics
from sfmcpp.weighting.trials import Trials, admissible

# Converged where no weight changes by more than this, in logarithm; rounds at most.
_SETTLED = 0.02
_ROUNDS = 12
# The minimum of the model is taken for the optimum if the cost falls by this share of the predicted decrease,
# less a share of the cost for rounding; converged where the predicted decrease is below a share of the cost.
_KEPT_SHARE = 0.7
_ROUNDING = 1e-6
_NEAR = 1e-3
# Weights at which too many inliers are lost are multiplied by this, so often at most.
_RELIEF = 0.3
_RELIEFS = 20


class VarianceSearch:
    """Linear models visited so far, each at the minimum that the previous one predicted.

    At each, every weight goes to the maximum of the restricted likelihood, until no weight changes: Helmert's
    simultaneous estimation, with one Gauss–Newton step per round. Once a step has decreased the cost by much
    less than its model predicted, the problem is fitted by the minimiser instead.

    Parameters
    ----------
    fits : WeightFits
        Problem and groups.
    start : FitStatistics
        The linear model at an optimum, of its weights or others.
    chosen : sequence of int
        The groups to weigh.
    """

    def __init__(self, fits: WeightFits, start: FitStatistics, chosen: Sequence[int]) -> None:
        self._fits, self._chosen = fits, list(chosen)
        # Whether all steps so far have decreased the cost as predicted; too large problems take none.
        self._steps = not start.too_large
        self._visited = [self._at_optimum(start)]

    @property
    def last(self) -> FitStatistics:
        """The linear model visited last."""
        return self._visited[-1]

    def run(self) -> None:
        """Estimate the weights of all chosen groups together."""
        for _ in range(_ROUNDS):
            proposed = self._next_weights()
            chosen = proposed[self._chosen] / self.last.weights[self._chosen]  # others may have no weight
            change = np.abs(np.log(chosen)).max()
            if change < _SETTLED and self.last.step.decrease < _NEAR * self.last.linear.cost:
                break
            self._add_iterate(proposed if change >= _SETTLED else self.last.weights)
        for _ in range(_RELIEFS):
            if admissible(self._fits, [self.last.fit])[0]:
                break
            relieved = self.last.weights.copy()
            relieved[self._chosen] = [self._fits.bounded(k, _RELIEF * relieved[k]) for k in self._chosen]
            self._add_iterate(relieved)

    def trials(self, k: int) -> Trials:
        """The optima in the order of the weights of one chosen group; of equal weights the last."""
        latest = {float(at.weights[k]): i for i, at in enumerate(self._visited)}
        order = [latest[weight] for weight in sorted(latest)]
        terms = [self._visited[i].likelihood_terms(self._chosen) for i in order]
        optima = [self._visited[i].fit for i in order]
        return Trials(
            weights=np.array(sorted(latest)),
            fits=optima,
            score=np.array([cost / self.last.image_sigma**2 + rest for cost, rest in terms]),
            admissible=admissible(self._fits, optima),
            index=order.index(len(self._visited) - 1),
        )

    def _add_iterate(self, weights: FloatArray) -> None:
        found = FitStatistics(self._fits, self.last.step.problem, weights)
        self._visited.append(self._at_optimum(found))

    def _at_optimum(self, at: FitStatistics) -> FitStatistics:
        """The model itself if its minimum is the optimum; else the model at the optimum of the minimiser."""
        if self._steps:
            actual, predicted = at.decreases
            self._steps = actual >= _KEPT_SHARE * predicted - _ROUNDING * 2 * at.linear.cost
        if self._steps:
            return at
        problem = self._fits.fit(at.weights, at.problem, brief=True).problem
        return FitStatistics(self._fits, problem, at.weights, settled=True)

    def _next_weights(self) -> FloatArray:
        weights: FloatArray = self.last.weights.copy()
        for k in self._chosen:
            weights[k] = self._fits.bounded(k, weights[k] * self.last.best_factor(k))
        return weights
