"""Solving every start by every method."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import sfmcpp
from experiments.description import Row
from experiments.starts import Start

FloatArray = NDArray[np.float64]
StartKey = tuple[str, str, int]


@dataclass(frozen=True)
class Run:
    """One solve of one start.

    Attributes
    ----------
    label : str
        Of the method.
    start : (str, str, int)
        Name, camera model and seed of the start.
    summary : sfmcpp.Summary
        What the solve did.
    """

    label: str
    start: StartKey
    summary: sfmcpp.Summary

    @property
    def camera_model(self) -> str:
        """Of the problem that was solved."""
        return self.start[1]

    @property
    def costs(self) -> FloatArray:
        """Cost of the accepted state after each step tried; the first is the initial one."""
        return np.array([iteration.cost for iteration in self.summary.iterations])


def solve_in_turn(starts: Iterable[Start], methods: Mapping[str, Row]) -> list[Run]:
    """Solve each start by all methods before the next, beginning with another method each time.

    Whatever else the machine does slows all methods alike then.
    """
    runs = []
    for number, start in enumerate(starts):
        labels = list(methods)
        first = number % len(labels)
        runs += [solve(start, label, methods[label]) for label in labels[first:] + labels[:first]]
    return runs


def solve(start: Start, label: str, options: Row) -> Run:
    """Solve a copy of the start."""
    problem = start.problem.copy()
    key = (start.name, problem.camera_model, start.seed)
    return Run(label, key, sfmcpp.solve(problem, **options))


def select(runs: Iterable[Run], label: str, camera_model: str | None = None) -> list[Run]:
    """The runs of one method, in one camera model if given."""
    return [run for run in runs if run.label == label and camera_model in (None, run.camera_model)]


def camera_models(runs: Iterable[Run]) -> list[str]:
    """The camera models that were solved, in their order."""
    return list(dict.fromkeys(run.camera_model for run in runs))
