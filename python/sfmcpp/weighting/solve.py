"""Bundle adjustment in one call, with weight selection first where asked for."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping
from copy import copy
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

from sfmcpp.ba.adjust import Callback, adjust, adjust_on_ranks, require_callback
from sfmcpp.ba.arrays import with_own_fields
from sfmcpp.ba.check import check_part
from sfmcpp.ba.checkpoints import CheckpointStore
from sfmcpp.ba.contradictions import contradiction_warnings
from sfmcpp.ba.options import OPTIONS, SolveOptions, takes_options
from sfmcpp.ba.parts import OwnParts, Scattered, gathered, is_whole_on_root, require_alike
from sfmcpp.ba.ranks import Communicator, Ranks
from sfmcpp.ba.summary import Summary
from sfmcpp.ba.time_limit import TimeLimit
from sfmcpp.model import Problem
from sfmcpp.model.camera_models import require_named
from sfmcpp.model.named_fields import meant
from sfmcpp.model.residual_group import Group, checked_groups
from sfmcpp.model.weight_selection import WeightSelection
from sfmcpp.weighting.problem import frame_conflict, select_group_weights

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from sfmcpp._core import SolveKeywords


@takes_options
def solve(
    problem: Problem | None,
    *,
    constraints: Iterable[Group] = (),
    weight: str | Mapping[str, str] | None = None,
    callback: Callback | None = None,
    checkpoint: CheckpointStore | None = None,
    resume: CheckpointStore | None = None,
    comm: Communicator | None = None,
    **options: Unpack[SolveKeywords],
) -> Summary:
    """Adjust cameras, intrinsics and points of a problem, in place.

    Minimises ½ Σ ρ(‖r‖²) + the costs of the constraints over all free parameters, r = (observed − projected)
    / σ. The loss may also be a :class:`LossFunction`, the camera model of the problem a
    :class:`CameraFunction`.

    Parameters
    ----------
    problem : Problem
        Its arrays `cameras`, `intrinsics` and `points` are overwritten with the best state found, however the
        solve ends. Use ``problem.copy()`` to keep the initial values.
    constraints : iterable of ConstraintGroup or ResidualGroup
        Named weighted groups of constraints on the cameras; see :class:`ConstraintGroup`, and
        :class:`ResidualGroup` for residuals by your own function. Metric camera models only. Algebraic line
        searches consider only the pixels.
    weight : str or mapping of str to str, optional
        How to choose the weights of the groups from the data before the solve: one method for all groups, or
        a mapping from group names to methods; other groups keep their weights. None: all groups do. The
        chosen weight is stored in the attribute `weight` of its group; the solve has the same bits as one
        given that weight.

        - "variance", and "auto" with it: restricted likelihood (variance components), several groups
          together. A prior proportional to σ keeps it from zero: σ² = Σ e² / (r − 1), larger than the
          restricted maximum's Σ e² / r, with r the redundancy; above 4000 free parameters of cameras sixty
          members of a group stand for that of all. With normal sensor noise it recovers the standard
          deviation to a fraction of 1 / √(2r), if r is not small. The choice and the solve together cost two
          to three and a half times the solve alone (BAL problem-49, and a scene of 15,000 observations
          solved in 10 ms).
        - "loo-approx": leave-one-out cross-validation of the observations, in closed form, over 21 weights:
          the mean of Tukey's loss, with 4.7 times the noise of the images alone as its scale, of the errors
          with which all others predict each observation of a point with three views or more.
        - "k-fold": the same with refits that leave out a quarter of the observations; for problems of any
          size.
        - "l-curve", "l-curve-scaled", "ltn": trade-off criteria over 17 weights (thesis §2.4). Cheap, for
          problems of any size, often far off.

        On scenes with sensors of known noise (bench/experiments, "whole-weights") the error with "variance"
        is 1 % above that with the true weights in the median, at most 8 %; with cross-validation 0 to 3 %,
        but in some runs it chose no weight at all, or one far off; with trade-off criteria 1 to 330 %. A
        faulty sensor bends the result where the images drift as much, and its equivalent standard deviation
        grows less than it should.

        Own residuals have a standard deviation in their own unit: 1 if they are divided by σ. In a group with
        a robust loss, members beyond 4.6 standard deviations do not influence the weight.

        The chosen weight keeps 90 % of the inliers of the images alone, if any weight does. All fits use the
        loss, linear solver, gauge and limits given here, each separately. Ctrl-C during the choice raises
        KeyboardInterrupt and leaves everything unchanged.
    callback : callable, optional
        Called as ``callback(iteration)`` after every iteration; returning False stops the solve.
    checkpoint : CheckpointFolder, optional
        Where to save the state, periodically and when the solve is stopped, to resume from later. If saving
        fails during the solve, the solve continues, and a warning in the summary names the file.
    resume : CheckpointFolder, optional
        Where an earlier call with the same arguments saved checkpoints; the solve resumes from the newest.
        `problem` must have its initial values, for example read again. The result has the bits of one call
        that was never stopped, except for times. `threads`, `max_iterations` and `max_seconds` may differ;
        limits, history and seconds cover both calls together. Weights are chosen again, with the same result.
        The callback is called for new iterations only.
    comm : mpi4py.MPI.Comm, optional
        MPI processes that solve the problem together. Each calls this with the same arguments, except for
        `problem`, `callback` and `threads`. Runs with the same number of processes have the same bits, and
        with the linear solver "iterative" those with any number; with direct ones, costs of another number
        agree to rounding. Weights are chosen by rank 0, which gathers the parts. Each rank has its own
        checkpoints in the folder; resume with the same number of ranks. Run the program with ``mpiexec -n N
        python -m mpi4py PROGRAM``, so that an exception on one rank ends all.
    **options

    Returns
    -------
    Summary
        Costs, termination, history and warnings. Also after Ctrl-C, with termination "interrupted".

    Raises
    ------
    InvalidArgument
        If the problem or an option is invalid; the message names it, and the problem is unchanged. With
        `weight`: if there is nothing to choose from, the problem is too large for the method, or a name is
        unknown.
    DatasetError
        If `checkpoint` cannot be written or has checkpoints of an earlier run; if `resume` has no complete
        checkpoint, or one of another problem, other options, another version or instruction set. The problem
        is unchanged.
    """
    if comm is not None:
        ranks = Ranks(comm)
        groups, settings = ranks.agreed(lambda: _checked_arguments(constraints, callback, options))
        ranks.agreed(lambda: _refuse_what_one_process_needs(problem))
        kept = checkpoint, resume
        require_alike(ranks, {name: bool(k) for name, k in zip(("checkpoint", "resume"), kept, strict=True)})
        return _solve_on_ranks(problem, groups, weight, settings, ranks, callback, *kept)
    groups, settings = _checked_arguments(constraints, callback, options)
    given = with_own_fields(cast(Problem, problem))  # a callback may assign to those of the caller
    limit = TimeLimit(settings.max_seconds)
    weights = _choose_weights(given, groups, weight, settings)
    if weight is not None:
        settings = SolveOptions.from_dict(limit.of(settings.to_dict()))
    own = [copy(group) for group in groups]
    summary = adjust(given, own, settings, callback, checkpoint, resume)
    return weights.describe(summary, contradiction_warnings(given, own, summary, settings))


def _checked_arguments(
    constraints: Iterable[Group], callback: Callback | None, options: SolveKeywords
) -> tuple[list[Group], SolveOptions]:
    for name in options:
        if name not in OPTIONS:
            known = inspect.signature(solve).parameters
            raise TypeError(f"solve() got an unexpected keyword argument {name!r}{meant(name, known)}")
    settings = SolveOptions(**options)
    settings.validate()
    require_callback(callback)
    return checked_groups(constraints), settings


def _refuse_what_one_process_needs(problem: Problem | None) -> None:
    if isinstance(problem, Problem):
        require_named(problem.camera_model, "on several ranks")


@dataclass(frozen=True)
class _Weights:
    """Weights of the groups of a solve, the selections among them, and warnings."""

    all: list[float]
    chosen: list[WeightSelection]
    warnings: list[str]

    def describe(self, summary: Summary, contradictions: list[str]) -> Summary:
        ends = [
            f"constraints[{one.name!r}]: the weight by {one.method} is at the end of what was tried "
            f"(σ = {one.sensor_sigma:.3g} {one.unit}), with no better one inside: declare σ, or choose by "
            "'variance'"
            for one in self.chosen
            if one.at_end
        ]
        added = [*self.warnings, *ends, *contradictions]
        if not (self.chosen or added):
            return summary
        return replace(summary, group_weights=self.chosen, warnings=[*summary.warnings, *added])


def _choose_weights(
    problem: Problem,
    groups: list[Group],
    weight: str | Mapping[str, str] | None,
    settings: SolveOptions,
) -> _Weights:
    chosen = [] if weight is None else select_group_weights(problem, groups, weight, settings)
    apart = [message for group in groups if (message := frame_conflict(problem, group)) is not None]
    return _Weights([group.weight for group in groups], chosen, apart)


def _solve_on_ranks(
    problem: Problem | None,
    groups: list[Group],
    weight: str | Mapping[str, str] | None,
    settings: SolveOptions,
    ranks: Ranks,
    callback: Callback | None,
    checkpoint: CheckpointStore | None,
    resume: CheckpointStore | None,
) -> Summary:
    def weigh(whole: Problem | None) -> _Weights:
        checked = cast(Problem, whole)  # used where there is one
        check_part(checked)
        return _choose_weights(checked, groups, weight, settings)

    parts: Scattered | OwnParts
    if is_whole_on_root(problem, ranks):
        weights = ranks.from_root(lambda: weigh(problem))
        parts = Scattered(problem, ranks)
    else:
        parts = OwnParts(cast(Problem, problem), ranks)
        ranks.agreed(lambda: check_part(parts.mine))
        whole = parts.mine if weight is None else gathered(parts, ranks)
        weights = ranks.from_root(lambda: weigh(whole))
    for group, value in zip(groups, weights.all, strict=True):
        group.weight = value
    summary = adjust_on_ranks(parts, groups, settings, callback, ranks, checkpoint, resume)
    far = contradiction_warnings(parts.mine, groups, summary, settings, whole=False)
    return weights.describe(summary, far)
