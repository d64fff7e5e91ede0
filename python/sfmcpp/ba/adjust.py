"""A single run of the core's minimiser, by one process or by several ranks."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from sfmcpp import _core
from sfmcpp.ba.arrays import core_arrays, core_constraints
from sfmcpp.ba.check import with_ids_of_points
from sfmcpp.ba.checkpoints import CheckpointStore, RankCheckpoints, RunCheckpoints, digest, facts_of_run
from sfmcpp.ba.doubtful_input import (
    warnings_about_calibration,
    warnings_about_functions,
    warnings_about_loss,
    warnings_about_result,
    warnings_about_sigmas,
)
from sfmcpp.ba.options import SolveOptions
from sfmcpp.ba.parts import OwnParts, Scattered, require_alike
from sfmcpp.ba.ranks import Ranks, interrupts_held
from sfmcpp.ba.summary import Iteration, LinearSolverChange, LinearSolverForecast, RankLoad, Summary
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import LossFunction, Problem
from sfmcpp.model.arguments import require_instance
from sfmcpp.model.arrays import number_array
from sfmcpp.model.camera_models import require_named
from sfmcpp.model.residual_group import Group, ResidualGroup, require_kinds

Callback = Callable[[Iteration], "bool | None"]


# Not `checked`: to read annotations takes half a millisecond of the first call, more than a small step.
def adjust(
    problem: Problem,
    constraints: Sequence[Group],
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
    constraints : sequence of ConstraintGroup or ResidualGroup
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
    require_instance("problem", problem, Problem)
    require_instance("options", options, SolveOptions)
    require_callback(callback)
    for name, store in (("checkpoint", checkpoint), ("resume", resume)):
        if store is not None:
            require_instance(name, store, CheckpointStore)
    report = None if callback is None else lambda core: continues_after(callback(_iteration(core)))
    if checkpoint is not None or resume is not None:
        _require_names_of_losses(constraints, options, "in a run that is saved")
        require_named(problem.camera_model, "in a run that is saved")
    arrays = _arrays(problem, constraints)
    checkpoints = RunCheckpoints(
        checkpoint,
        resume,
        lambda: _run_facts(problem, constraints, arrays, options),
        _checkpoint_bytes(arrays),
    )
    about_functions = list(warnings_about_functions(problem, constraints))
    given = number_array("intrinsics", problem.intrinsics).copy()
    core = _core.solve(arrays, options, report, *_save_and_resume(checkpoints))
    unit = _unit_of_residuals([_has_own_sigmas(arrays)])
    summary = _summary(core, options, unit)
    calibration = warnings_about_calibration(problem, given)
    if unit == "px" and not calibration:  # which explains the result
        calibration += warnings_about_result(problem, summary)
    warnings = [
        *with_ids_of_points(summary.warnings, problem),
        *about_functions,
        *calibration,
        *warnings_about_sigmas(problem, summary),
        *warnings_about_loss(arrays, summary),
        *checkpoints.warnings,
    ]
    return summary if warnings == summary.warnings else replace(summary, warnings=warnings)


def require_callback(callback: Callback | None) -> None:
    """Raise InvalidArgument for what cannot be called after an iteration."""
    if callback is not None and not callable(callback):
        raise InvalidArgument(f"callback = {callback!r}: must be callable")
    if inspect.iscoroutinefunction(callback):
        raise InvalidArgument(f"callback = {callback!r}: must not be async, nothing would await it")


def adjust_on_ranks(
    parts: Scattered | OwnParts,
    constraints: Sequence[Group],
    options: SolveOptions,
    callback: Callback | None,
    ranks: Ranks,
    checkpoint: CheckpointStore | None,
    resume: CheckpointStore | None,
) -> Summary:
    """Adjust a problem together with other processes; each calls this.

    Parameters
    ----------
    parts : Scattered or OwnParts
        Of which each rank has one.
    constraints : sequence of ConstraintGroup
        All groups, the same on every rank.
    options : SolveOptions
        All options, the same on every rank but for `threads`.
    callback : callable or None
        As of :func:`adjust`, of this rank; what it raises is raised on all.
    ranks : Ranks
        The processes.
    checkpoint, resume : CheckpointStore or None
        As of :func:`adjust`; each rank has its own in it.

    Returns
    -------
    Summary
        What the minimiser did, the same on every rank but for seconds and threads.

    Raises
    ------
    InvalidArgument
        If a part, a group or an option breaks a rule, or what must be the same differs; on all ranks.
    DatasetError
        As :func:`adjust`, on all ranks; also if `resume` is of another number of ranks.
    """
    ranks.agreed(lambda: require_kinds(constraints, "on several ranks"))
    ranks.agreed(lambda: _require_names_of_losses(constraints, options, "on several ranks"))
    arrays = ranks.agreed(lambda: _arrays(parts.mine, constraints))
    common = {name: value for name, value in options.to_dict().items() if name != "threads"}
    require_alike(ranks, common | {f"constraints[{g['name']!r}]": g for g in arrays["constraints"]})
    own = SolveOptions(**{**options.to_dict(), "threads": options.threads or ranks.cores_of_this()})
    exchange = _core.CommunicatorExchange(ranks.communicator)
    listener = _RankListener(callback, exchange)
    checkpoints = RankCheckpoints(
        checkpoint,
        resume,
        lambda: _run_facts(parts.mine, constraints, arrays, options),
        _checkpoint_bytes(arrays),
        ranks,
    )
    with interrupts_held(exchange.interrupt) as waiting:
        core = _core.solve(arrays, own, listener, *_save_and_resume(checkpoints), exchange)
        parts.collect()
        ranks.agreed(listener.reraise)
        unit = _unit_of_residuals(ranks.everyones(_has_own_sigmas(arrays)))
        summary = _summary(core, options, unit)
        loads = ranks.everyones(_rank_load(parts.mine, core, exchange))
        iterations = listener.all_with_bytes(summary.iterations)
        about_loss = warnings_about_loss(arrays, summary, ranks)
        if summary.termination == "interrupted":
            waiting.clear()  # those of all ranks are one, whenever they come
    warnings = [*summary.warnings, *about_loss, *checkpoints.warnings]
    return replace(summary, iterations=iterations, ranks=loads, warnings=warnings)


def _require_names_of_losses(constraints: Sequence[Group], options: SolveOptions, what: str) -> None:
    """Refuse losses that are functions: another run or process cannot check that it has the same one."""
    for loss in (options.loss, *(group.loss for group in constraints)):
        if isinstance(loss, LossFunction):
            raise InvalidArgument(f"loss = {loss!r}: must be the name of a loss {what}")


def _checkpoint_bytes(arrays: dict[str, Any]) -> int:
    return sum(number_array(name, arrays[name]).nbytes for name in ("cameras", "intrinsics", "points"))


def _save_and_resume(checkpoints: RunCheckpoints | RankCheckpoints) -> tuple[Any, Any]:
    """The function that the core calls to save a checkpoint, and the arrays to resume from."""
    taken = checkpoints.taken
    saved = checkpoints.offer if checkpoints.are_saved else None
    return saved, None if taken is None else dict(taken.arrays)


class _RankListener:
    """Hears of the iterations on one rank. What a callback raises waits until all ranks have stopped."""

    def __init__(self, callback: Callback | None, exchange: _core.CommunicatorExchange) -> None:
        self._callback, self._exchange = callback, exchange
        self._sent = 0.0  # before the next iteration
        self._sent_for: dict[int, float] = {}
        self._failure: Exception | None = None

    def with_bytes(self, iteration: Iteration) -> Iteration:
        """An iteration with what was sent for it; an earlier run's is not known."""
        return replace(iteration, bytes_sent=self._sent_for.get(iteration.iteration, 0.0))

    def all_with_bytes(self, iterations: list[Iteration]) -> list[Iteration]:
        """All iterations; an interrupt may have prevented the report of the last one."""
        self._sent_for.setdefault(iterations[-1].iteration, self._exchange.bytes_sent - self._sent)
        return [*map(self.with_bytes, iterations)]

    def __call__(self, core: _core.CoreIteration) -> bool:
        sent = self._exchange.bytes_sent
        self._sent_for[core.iteration], self._sent = sent - self._sent, sent
        try:
            return self._callback is None or continues_after(
                self._callback(self.with_bytes(_iteration(core)))
            )
        except Exception as error:
            self._failure = error
            return False

    def reraise(self) -> None:
        if self._failure is not None:
            raise self._failure


def _rank_load(part: Problem, core: _core.CoreSummary, exchange: _core.CommunicatorExchange) -> RankLoad:
    return RankLoad(
        points=part.num_points,
        observations=part.num_observations,
        threads=core.threads,
        seconds_computing=core.seconds_total - exchange.seconds_waited,
        seconds_waiting=exchange.seconds_waited,
        messages=exchange.messages,
        bytes_sent=exchange.bytes_sent,
    )


def _arrays(problem: Problem, constraints: Sequence[Group]) -> dict[str, Any]:
    return {**core_arrays(problem), "constraints": core_constraints(constraints, problem)}


def _has_own_sigmas(arrays: dict[str, Any]) -> bool:
    """Whether any observation of a problem's arrays has another σ than 1 px."""
    sigma = arrays["sigma_px"]
    return arrays["covariance_px2"] is not None or (
        sigma is not None and bool((np.asarray(sigma) != 1).any())
    )


def _unit_of_residuals(own_sigmas: Iterable[bool]) -> str:
    """Unit of residuals: pixels, or σ if any part of a problem has its own."""
    return "σ" if any(own_sigmas) else "px"


def _run_facts(
    problem: Problem, constraints: Sequence[Group], arrays: dict[str, Any], options: SolveOptions
) -> dict[str, Any]:
    """Identity of a run: a digest of each array of the problem and of each group of constraints."""
    digests = {name: digest(value) for name, value in arrays.items() if name != "constraints"}
    for group, known in zip(constraints, arrays["constraints"], strict=True):
        digests[f"constraints {group.name!r}"] = digest(known | _residuals_of_function(problem, group))
    return facts_of_run("solve", problem=digests, options=options.to_dict())


def _residuals_of_function(problem: Problem, group: Group) -> dict[str, Any]:
    """Identity of a user function: its residuals at the start."""
    return {"function": group.residuals_at(problem)} if isinstance(group, ResidualGroup) else {}


def _fields_of(core: type, cls: type) -> list[str]:
    return [name for name in cls.__dataclass_fields__ if hasattr(core, name)]  # type: ignore[attr-defined]


_OF_ITERATION = _fields_of(_core.CoreIteration, Iteration)
_OF_SUMMARY = _fields_of(_core.CoreSummary, Summary)


def _iteration(core: _core.CoreIteration) -> Iteration:
    return Iteration(**{name: getattr(core, name) for name in _OF_ITERATION})


def _summary(core: _core.CoreSummary, options: SolveOptions, rms_unit: str) -> Summary:
    values: dict[str, Any] = {name: getattr(core, name) for name in _OF_SUMMARY}
    values["iterations"] = [_iteration(iteration) for iteration in core.iterations]
    values["linear_solver_forecast"] = [
        LinearSolverForecast(**forecast) for forecast in core.linear_solver_forecast
    ]
    values["linear_solver_changes"] = [LinearSolverChange(**change) for change in core.linear_solver_changes]
    used = {name: getattr(options, name) for name in ("method", "line_search", "loss")}
    return Summary(**values, **used, rms_unit=rms_unit, options=options.to_dict(), version=_core.__version__)


def continues_after(answer: object) -> bool:
    """Whether a run continues after this answer of a callback: only False, Python's or NumPy's, stops it."""
    return not isinstance(answer, bool | np.bool_) or bool(answer)
