"""Bundle adjustment in one call: the weights of constraints are chosen first, where asked for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any, Literal

from sfmcpp.ba.adjust import Callback, adjust
from sfmcpp.ba.options import SolveOptions
from sfmcpp.ba.summary import Summary
from sfmcpp.model import ConstraintGroup, Problem
from sfmcpp.weighting.whole.selection import select_group_weights


def solve(
    problem: Problem,
    *,
    constraints: Iterable[ConstraintGroup] = (),
    weight: str | Mapping[str, str] | None = None,
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
    weight : str or mapping of str to str, optional
        How to choose the weights of the groups from the data before the solve: one method for all, or the
        method of some by their names, the others keeping their weights. None: all keep theirs. The chosen
        weight replaces the attribute `weight` of its group; the solve is then the same, bit for bit, as one
        given that weight.

        - "variance", and "auto" with it: restricted likelihood (variance components), several groups
          together; for up to 4000 free parameters of cameras. Where the noise of a sensor is normal, it
          recovers its standard deviation as well as the redundancy r allows, to a share of 1 / √(2r). It
          costs five to six solves of BAL problem-49 with NumPy's BLAS on one thread (nine to thirteen on two
          busy cores with two), and some twenty of a small scene solved in 10 ms.
        - "loo-approx": leave-one-out cross-validation of the observations, in closed form, over 21 weights.
        - "k-fold": the same by refits without a quarter of the observations; for problems of any size.
        - "l-curve", "l-curve-scaled", "ltn": trade-off criteria over 17 weights (thesis §2.4). Cheap, of any
          size, and often far off.

        On scenes with sensors of known noise (bench/experiments, "whole-weights") the first lost 1 % against
        the true weights in the median and at most 8 %; cross-validation 0 to 3 %, but in some runs it took no
        weight at all; trade-off criteria 1 to 330 %. A sensor that is wrong where the images drift as far
        bends the result, and its equivalent standard deviation grows less than it should.

        Every weight keeps 90 % of the inliers of the images alone, if any does. All fits use the loss,
        linear solver, gauge and limits given here, each for itself; Ctrl-C during the choice raises
        KeyboardInterrupt and leaves everything as it was.
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
        If the problem or an option breaks a rule; the message names it. The problem is untouched then. With
        `weight`: if there is nothing to choose from, the problem is too large for the method, or a name is
        unknown.
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
    groups = list(constraints)
    chosen = [] if weight is None else select_group_weights(problem, groups, weight, options)
    return replace(adjust(problem, groups, options, callback), group_weights=chosen)
