"""Bundle adjustment in one call, and the checks that belong to it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from sfmcpp import _core
from sfmcpp.ba.arrays import core_arrays, core_constraints
from sfmcpp.ba.options import SolveOptions
from sfmcpp.ba.summary import Iteration, Summary
from sfmcpp.model import ConstraintGroup, Problem

METHODS: tuple[str, ...] = _core.METHODS
LINE_SEARCHES: tuple[str, ...] = _core.LINE_SEARCHES
LINEAR_SOLVERS: tuple[str, ...] = _core.LINEAR_SOLVERS
LOSSES: tuple[str, ...] = _core.LOSSES
GAUGES: tuple[str, ...] = _core.GAUGES

Callback = Callable[[Iteration], "bool | None"]


def solve(
    problem: Problem,
    *,
    constraints: Iterable[ConstraintGroup] = (),
    method: str = "lm-nielsen",
    line_search: str = "none",
    line_search_iterations: int = 5,
    linear_solver: str = "auto",
    loss: str = "squared",
    loss_scale_px: float | Literal["auto"] = 1.0,
    max_iterations: int = 50,
    max_seconds: float | None = None,
    function_tolerance: float = 1e-6,
    threads: int = 0,
    gauge: str = "auto",
    callback: Callback | None = None,
    **more: Any,
) -> Summary:
    """Adjust cameras, intrinsics and points of a problem, in place.

    Minimises ½ Σ ρ(‖r‖²) over everything that is free, r = (observed − projected) / σ, and the costs of
    the constraints, to which the robust loss does not apply.

    Parameters
    ----------
    problem : Problem
        Its arrays `cameras`, `intrinsics` and `points` hold the best state found afterwards, however the
        solve ends. Use ``problem.copy()`` to keep the start.
    constraints : iterable of ConstraintGroup
        Named weighted groups of constraints on the cameras; see :class:`ConstraintGroup`. For metric
        camera models. An algebraic line search proposes its lengths by the pixels alone.
    method : str
        "lm-nielsen", "lm": Levenberg–Marquardt with the Nielsen or the Hartley rule; "dog-leg" (Powell's);
        "gauss-newton"; "gradient-descent"; "conjugate-gradient": nonlinear, with a block preconditioner;
        "alternation": resection–intersection.
    line_search : {"none", "g-als", "t-als", "exact", "soft", "backtracking"}
        How far to go along each step: algebraic with one length or two (thesis ch. 4), Frandsen's exact
        or soft search, backtracking.
    line_search_iterations : int
        Iterations, from the first on, that search.
    linear_solver : {"auto", "dense", "sparse", "iterative"}
        Solver of the reduced camera system; "auto" predicts what each would cost.
    loss : {"squared", "huber", "cauchy", "tukey"}
        Robust loss ρ.
    loss_scale_px : float or "auto"
        Where the loss leaves the parabola; "auto": from the median absolute residual at the start.
    max_iterations : int
        Steps tried at most, rejected ones included.
    max_seconds : float, optional
        Time limit [s].
    function_tolerance : float
        Stop when an accepted step decreases the cost by less than this share.
    threads : int
        0: as many as the machine has and the problem is worth. The result has the same bits for any.
    gauge : {"auto", "free", "fixed"}
        Whether damping holds the similarity freedom, or the first pose and the scale stay fixed, as far
        as neither what is fixed nor constraints hold them already.
    callback : callable, optional
        Called as ``callback(iteration)`` after every iteration; returning False stops the solve.
    **more
        Any other attribute of ``sfmcpp.SolveOptions``: `initial_damping`, `initial_radius`,
        `damping_matrix`, `line_search_damping`, `line_search_on_rejection`, `backtracking_test`,
        `algebraic_weights`, `gradient_tolerance`, `parameter_tolerance`, `pcg_tolerance`,
        `pcg_max_iterations`.

    Returns
    -------
    Summary
        Costs, termination, history and warnings. Ctrl-C returns too, with termination "interrupted".

    Raises
    ------
    InvalidArgument
        If the problem or an option breaks a rule; the message names it. The problem is untouched then.
    """
    values = {
        "method": method,
        "line_search": line_search,
        "line_search_iterations": line_search_iterations,
        "linear_solver": linear_solver,
        "loss": loss,
        "loss_scale_px": loss_scale_px,
        "max_iterations": max_iterations,
        "max_seconds": max_seconds,
        "function_tolerance": function_tolerance,
        "threads": threads,
        "gauge": gauge,
    }
    options = SolveOptions(**values, **more)
    options.validate()
    report = None if callback is None else lambda core: callback(_iteration(core))
    arrays = {**core_arrays(problem), "constraints": core_constraints(constraints)}
    return _summary(_core.solve(arrays, options, report), options)


def check(problem: Problem) -> list[str]:
    """Look a problem over without solving it.

    Parameters
    ----------
    problem : Problem
        The problem to check.

    Returns
    -------
    list of str
        What is legal but worth knowing: cameras or points without observations, points seen once, parts
        that share no point.

    Raises
    ------
    InvalidArgument
        If a rule is broken: the message names the array, the position, the value and the rule.
    """
    return list(_core.check(core_arrays(problem)))


def residuals(problem: Problem) -> NDArray[np.float64]:
    """Residuals (observed − projected) / σ of every observation.

    Parameters
    ----------
    problem : Problem
        The problem at its present state.

    Returns
    -------
    (M, 2) float64
        In the order of the observations; pixels over standard deviations.

    Raises
    ------
    InvalidArgument
        If the problem breaks a rule.
    """
    return _core.residuals(core_arrays(problem))


def cost(problem: Problem) -> float:
    """The squared cost ½ Σ ‖r‖² of a problem at its present state.

    Parameters
    ----------
    problem : Problem
        The problem at its present state.

    Returns
    -------
    float
        The cost, without robust loss.
    """
    r = residuals(problem)
    return 0.5 * float(np.vdot(r, r))


def check_jacobians(problem: Problem, max_observations: int = 1000) -> _core.JacobianCheck:
    """Compare the analytic derivatives with numeric ones at the present state of a problem.

    Parameters
    ----------
    problem : Problem
        The problem at its present state.
    max_observations : int
        Observations compared at most, spread evenly over the problem.

    Returns
    -------
    JacobianCheck
        `entries` compared, and the `worst_error` with its `worst_observation` and `worst_parameter`.
    """
    return _core.check_jacobians(core_arrays(problem), max_observations)


def _fields_of(core: object, cls: type) -> dict[str, Any]:
    return {name: getattr(core, name) for name in cls.__dataclass_fields__ if hasattr(core, name)}  # type: ignore[attr-defined]


def _iteration(core: _core.CoreIteration) -> Iteration:
    return Iteration(**_fields_of(core, Iteration))


def _summary(core: _core.CoreSummary, options: SolveOptions) -> Summary:
    values = _fields_of(core, Summary)
    values["iterations"] = [_iteration(iteration) for iteration in core.iterations]
    used = {name: getattr(options, name) for name in ("method", "line_search", "loss")}
    return Summary(**values, **used)
