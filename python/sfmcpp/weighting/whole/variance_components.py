"""Weights by variance components: what is left of each sensor after the fit, over its redundancy."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sfmcpp.model.arrays import FloatArray
from sfmcpp.weighting.whole.fits import WeightFit, WeightFits
from sfmcpp.weighting.whole.methods import Trials, admissible
from sfmcpp.weighting.whole.statistics import fit_statistics

# A change of a weight, in logarithm, that does not matter any more; rounds at most.
_SETTLED = 0.02
_ROUNDS = 10
# How weights that cost inliers come down, and how often.
_RELIEF = 0.3
_RELIEFS = 20


def variance_components(
    fits: WeightFits, weights: FloatArray, start: WeightFit, chosen: Sequence[int]
) -> list[Trials]:
    """Estimate the weights of several groups together.

    At an optimum every weight goes to the maximum of the restricted likelihood in the linear model there, and
    the problem is fitted again, until no weight changes: Helmert's simultaneous estimation.

    Parameters
    ----------
    fits : WeightFits
        Problem and groups.
    weights : (k,) float64
        Present weights.
    start : WeightFit
        The optimum at these weights.
    chosen : sequence of int
        The groups to weigh.

    Returns
    -------
    list of Trials
        One for each chosen group, of the same optima; the score is minus twice the logarithm of the
        restricted likelihood.

    Raises
    ------
    InvalidArgument
        If there are too many columns for dense matrices.
    """
    search = _Search(fits, list(chosen))
    search.visit(weights, start)
    for _ in range(_ROUNDS):
        proposed = search.proposed()
        if np.abs(np.log(proposed / search.weights[-1])).max() < _SETTLED:
            break
        search.visit(proposed)
    for _ in range(_RELIEFS):
        if admissible(fits, search.optima[-1:])[0]:
            break
        relieved = search.weights[-1].copy()
        relieved[search.chosen] = [fits.bounded(k, _RELIEF * relieved[k]) for k in search.chosen]
        search.visit(relieved)
    return [search.trials(k) for k in search.chosen]


class _Search:
    """Optima visited so far, and the linear model at the last."""

    def __init__(self, fits: WeightFits, chosen: list[int]) -> None:
        self.chosen = chosen
        self.weights: list[FloatArray] = []
        self.optima: list[WeightFit] = []
        self._fits = fits
        self._likelihoods: list[tuple[float, float]] = []

    def visit(self, weights: FloatArray, fit: WeightFit | None = None) -> None:
        fit = self._fits.fit(weights, self.optima[-1].problem) if fit is None else fit
        self._last = fit_statistics(self._fits, fit, weights)
        self.weights.append(weights)
        self.optima.append(fit)
        self._likelihoods.append(self._last.likelihood_terms(self.chosen))

    def proposed(self) -> FloatArray:
        weights: FloatArray = self.weights[-1].copy()
        for k in self.chosen:
            weights[k] = self._fits.bounded(k, weights[k] * self._last.best_factor(k))
        return weights

    def trials(self, k: int) -> Trials:
        """The optima in the order of the weights of one group; of equal weights the last."""
        latest = {float(weights[k]): i for i, weights in enumerate(self.weights)}
        order = [latest[weight] for weight in sorted(latest)]
        optima = [self.optima[i] for i in order]
        score = [cost / self._last.image_sigma**2 + rest for cost, rest in self._likelihoods]
        return Trials(
            weights=np.array(sorted(latest)),
            fits=optima,
            score=np.array([score[i] for i in order]),
            admissible=admissible(self._fits, optima),
            index=order.index(len(self.weights) - 1),
        )
