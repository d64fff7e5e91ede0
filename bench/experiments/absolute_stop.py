"""Table 4.1 once more, in the thesis' own unknowns and frame, with its absolute stop."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from matplotlib.figure import Figure

import sfmcpp
from experiments import homogeneous
from experiments.description import Experiment, Row
from experiments.measures import CONVERGED_WITHIN, mean, standard_error
from experiments.pictures import grouped_bars
from experiments.report import Report
from experiments.starts import in_model, noisy_scene
from sfmcpp import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.study.plotting.style import new_figure, style_axes

NOTES = (
    "calibrated, projective: sfmcpp. thesis: all 12 entries of a matrix and 4 of a point, in metres.",
    "iterations: steps tried until an accepted one lowers the sum of squares by less than 1e-10 px²;",
    "relative_stop: by less than 1e-6 of it. converged: within 1 % of the best of all from that start; the",
    "means are of these runs, over_LM is of those in which all methods of a parametrisation converge.",
)
COLUMNS = (
    "parametrisation", "label", "runs", "converged", "mean_iterations", "standard_error",
    "mean_iterations_relative_stop", "common", "over_LM",
)  # fmt: skip
_RELATIVE = 1e-6
PROCESSES = 2


@dataclass(frozen=True, eq=False)
class _Descent:
    """Sums of squares after each step tried, the first before any."""

    parametrisation: str
    label: str
    costs: FloatArray

    def steps(self, least_gain: float) -> int:
        """Steps until an accepted one gains less than that share of the cost, or all."""
        gains = self.costs[:-1] - self.costs[1:]
        little = np.flatnonzero((gains > 0) & (gains < least_gain * self.costs[:-1]))
        return int(little[0]) + 1 if len(little) else len(gains)


def convergence_in_the_thesis_unknowns(experiment: Experiment) -> Report:
    """Run every method from every start, in every parametrisation."""
    with ProcessPoolExecutor(PROCESSES) as pool:
        runs = list(pool.map(partial(_descents, experiment), experiment.seeds))
    names = dict.fromkeys(descent.parametrisation for descent in runs[0])
    rows = [row for name in names for row in _rows(name, runs)]
    return Report(NOTES, ("label", "parametrisation"), COLUMNS, rows, _picture(rows))


def _descents(experiment: Experiment, seed: int) -> list[_Descent]:
    start = noisy_scene(experiment, experiment.noise[0], seed)
    gain_px2, steps = experiment.settings["least_gain_px2"], experiment.options["max_iterations"]
    solves: dict[str, Callable[[str], FloatArray]] = {
        "calibrated": partial(_by_sfmcpp, experiment, in_model(start, "own")),
        "projective": partial(_by_sfmcpp, experiment, in_model(start, "projective")),
        "thesis": lambda label: np.array(
            homogeneous.adjust(*homogeneous.world_of(start), label, gain_px2, steps).costs
        ),
    }
    return [
        _Descent(name, label, _until(solve(label), gain_px2))
        for name, solve in solves.items()
        for label in experiment.methods
    ]


def _by_sfmcpp(experiment: Experiment, start: Problem, label: str) -> FloatArray:
    never = {name: 0.0 for name in ("function_tolerance", "gradient_tolerance", "parameter_tolerance")}
    summary = sfmcpp.solve(start.copy(), **{**experiment.solve_options()[label], **never})
    return 2 * np.array([iteration.cost for iteration in summary.iterations])


def _until(costs: FloatArray, gain_px2: float) -> FloatArray:
    """Costs up to the first accepted step that gains less than that."""
    gains = costs[:-1] - costs[1:]
    little = np.flatnonzero((gains > 0) & (gains < gain_px2))
    return costs[: little[0] + 2] if len(little) else _without_idle_end(costs)


def _without_idle_end(costs: FloatArray) -> FloatArray:
    """Costs up to the first step after which nothing is gained any more."""
    last = int(np.flatnonzero(costs > costs[-1])[-1]) + 1
    return costs[: last + 2]


def _rows(name: str, runs: list[list[_Descent]]) -> list[Row]:
    of_name = [{d.label: d for d in run if d.parametrisation == name} for run in runs]
    best = [min(d.costs[-1] for d in run) for run in runs]
    good = [
        {label for label, d in found.items() if d.costs[-1] <= (1 + CONVERGED_WITHIN) * least}
        for found, least in zip(of_name, best, strict=True)
    ]
    labels = list(of_name[0])
    common = [found for found, names in zip(of_name, good, strict=True) if len(names) == len(labels)]
    return [
        {
            "parametrisation": name,
            "label": label,
            "runs": len(runs),
            "common": len(common),
            **_means([found[label] for found, names in zip(of_name, good, strict=True) if label in names]),
            "over_LM": _over(labels[0], label, common),
        }
        for label in labels
    ]


def _means(converged: list[_Descent]) -> Row:
    return {
        "converged": len(converged),
        "mean_iterations": mean(len(d.costs) - 1 for d in converged),
        "standard_error": standard_error(len(d.costs) - 1 for d in converged),
        "mean_iterations_relative_stop": mean(d.steps(_RELATIVE) for d in converged),
    }


def _over(first: str, label: str, common: list[dict[str, _Descent]]) -> float | None:
    if not common:
        return None
    return sum(len(d[label].costs) - 1 for d in common) / sum(len(d[first].costs) - 1 for d in common)


def _picture(rows: list[Row]) -> Figure:
    figure = new_figure(7, 4)
    axes = figure.subplots()
    labels = list(dict.fromkeys(row["label"] for row in rows))
    names = list(dict.fromkeys(row["parametrisation"] for row in rows))
    found = {(row["parametrisation"], row["label"]): row["mean_iterations"] for row in rows}
    grouped_bars(axes, {label: [found[name, label] or np.nan for name in names] for label in labels})
    axes.set_xticks(range(len(names)), names)
    axes.set_ylabel("mean iterations, absolute stop")
    style_axes(axes)
    axes.legend(frameon=False, fontsize=8)
    return figure
