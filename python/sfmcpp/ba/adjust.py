"""One run of the core's minimiser."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from sfmcpp import _core
from sfmcpp.ba.arrays import core_arrays, core_constraints
from sfmcpp.ba.checkpoints import CheckpointStore, RunCheckpoints, digest, facts_of_run
from sfmcpp.ba.options import SolveOptions
from sfmcpp.ba.summary import Iteration, LinearSolverChange, LinearSolverForecast, Summary
from sfmcpp.model import ConstraintGroup, Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import number_array

Callback = Callable[[Iteration], "bool | None"]


@checked()
def adjust(
    problem: Problem,
    constraints: Sequence[ConstraintGroup],
    options: SolveOptions,
    callback: Callback | None = None,
    checkpoint: CheckpointStore | None = None,
    resume: CheckpointStore | None = None,
) -> Summary:
    """Adjust a problem in place with every group at its weight.

    Parameters
    ----------
    problem : Problem
        Holds the best state found afterwards.
    constraints : sequence of ConstraintGroup
        Groups of constraints.
    options : SolveOptions
        All options.
    callback : callable, optional
        Called after every iteration; returning False stops.
    checkpoint, resume : CheckpointStore, optional
        Where to save checkpoints, and where to take up an earlier run.

    Returns
    -------
    Summary
        What the minimiser did.

    Raises
    ------
    InvalidArgument
        If the problem, a group or an option breaks a rule.
    DatasetError
        If `checkpoint` cannot be written, or `resume` has no checkpoint of this run.
    """
    report = None if callback is None else lambda core: callback(_iteration(core))
    arrays = {**core_arrays(problem), "constraints": core_constraints(constraints)}
    least_bytes = sum(number_array(name, arrays[name]).nbytes for name in ("cameras", "intrinsics", "points"))
    checkpoints = RunCheckpoints(checkpoint, resume, lambda: _facts(arrays, options), least_bytes)
    taken, listener = checkpoints.taken, checkpoints.offer if checkpoints.are_saved else None
    core = _core.solve(arrays, options, report, listener, None if taken is None else dict(taken.arrays))
    summary = _summary(core, options)
    return replace(summary, warnings=[*summary.warnings, *checkpoints.warnings])


def _facts(arrays: dict[str, Any], options: SolveOptions) -> dict[str, Any]:
    """What is solved: a digest of each array of the problem and of each group of constraints."""
    digests = {name: digest(value) for name, value in arrays.items() if name != "constraints"}
    digests |= {f"constraints {group['name']!r}": digest(group) for group in arrays["constraints"]}
    return facts_of_run("solve", problem=digests, options=options.to_dict())


def _fields_of(core: object, cls: type) -> dict[str, Any]:
    return {name: getattr(core, name) for name in cls.__dataclass_fields__ if hasattr(core, name)}  # type: ignore[attr-defined]


def _iteration(core: _core.CoreIteration) -> Iteration:
    return Iteration(**_fields_of(core, Iteration))


def _summary(core: _core.CoreSummary, options: SolveOptions) -> Summary:
    values = _fields_of(core, Summary)
    values["iterations"] = [_iteration(iteration) for iteration in core.iterations]
    values["linear_solver_forecast"] = [
        LinearSolverForecast(**forecast) for forecast in core.linear_solver_forecast
    ]
    values["linear_solver_changes"] = [LinearSolverChange(**change) for change in core.linear_solver_changes]
    used = {name: getattr(options, name) for name in ("method", "line_search", "loss")}
    return Summary(**values, **used)
