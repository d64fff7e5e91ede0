"""What is measured of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from experiments.runs import FloatArray, Run, StartKey

# A run has converged if it ends within this of the best cost of all methods from the same start: "close to or
# below" that of Levenberg-Marquardt (thesis §4.4.2.2).
CONVERGED_WITHIN = 0.01
AT_MINIMUM_WITHIN = 1e-6


def best_costs(runs: Iterable[Run]) -> dict[StartKey, float]:
    """The lowest final cost from each start."""
    best: dict[StartKey, float] = {}
    for run in runs:
        best[run.start] = min(run.summary.final_cost, best.get(run.start, np.inf))
    return best


def has_converged(run: Run, best: Mapping[StartKey, float]) -> bool:
    """Whether the run ends close to the best cost from its start."""
    return run.summary.final_cost <= (1 + CONVERGED_WITHIN) * best[run.start]


def steps_tried(run: Run) -> int:
    """Steps until the stopping rule, rejected ones included."""
    return len(run.summary.iterations) - 1


def steps_to(run: Run, cost: float) -> int | None:
    """Steps until the cost is reached; None if it never is."""
    reached = run.costs <= cost
    return int(np.argmax(reached)) if reached.any() else None


def steps_to_own_minimum(run: Run) -> int:
    """Steps until within 1e-6 of the run's own final cost."""
    steps = steps_to(run, (1 + AT_MINIMUM_WITHIN) * run.summary.final_cost)
    assert steps is not None
    return steps


def cost_evaluations(run: Run) -> int:
    """Evaluations of the cost in all steps."""
    return sum(iteration.cost_evaluations for iteration in run.summary.iterations)


def normalised_rms(run: Run, steps: int) -> FloatArray:
    """(steps + 1,) RMS after each step over the initial one; after the end of the run that of the end."""
    costs = run.costs[: steps + 1]
    padded = np.concatenate([costs, np.full(steps + 1 - len(costs), costs[-1])])
    ratio: FloatArray = np.sqrt(padded / costs[0])
    return ratio


def mean(values: Iterable[float | None]) -> float | None:
    """Mean of what there is; None of nothing."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def standard_error(values: Iterable[float]) -> float | None:
    """Standard error of the mean; None of fewer than two values."""
    known = list(values)
    return float(np.std(known, ddof=1) / np.sqrt(len(known))) if len(known) > 1 else None
