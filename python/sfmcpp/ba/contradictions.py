"""Warnings about groups of constraints that end many standard deviations from what they say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from sfmcpp import _core
from sfmcpp.ba.linear_results import ConstraintRows
from sfmcpp.ba.linearize import LinearModel
from sfmcpp.ba.options import SolveOptions
from sfmcpp.ba.summary import Summary
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.residual_group import Group

# Standard deviations that neither noise nor a σ which is a guess explains.
FAR_SIGMAS = 100.0
_SQUARED = "squared"
# Share of members that are far where their median is: half, and less that rounding cannot hide.
_FAR_SHARE = 0.4
# Part of the pull of the others on a member from which on they are named.
_NAMED_SHARE = 0.1
_MOST_WARNINGS = 8


def contradiction_warnings(
    problem: Problem, groups: Sequence[Group], summary: Summary, options: SolveOptions, *, whole: bool = True
) -> list[str]:
    """Name the groups that a solve leaves far from what they say, and what holds them there.

    Parameters
    ----------
    problem : Problem
        The state at the end.
    groups : sequence of ConstraintGroup or ResidualGroup
        All groups of the solve.
    summary : Summary
        Its result; one that has not ended at a minimum tells nothing of the groups.
    options : SolveOptions
        Its options.
    whole : bool
        Whether the problem has all its observations; else nobody can say what holds a group.

    Returns
    -------
    list of str
        A sentence for each group without a robust loss of which some member, and for each with one of which
        the median member, is more than `FAR_SIGMAS` standard deviations off.
    """
    ended = summary.termination in ("converged", "stalled")
    if not ended or not any(_may_be_far(group, summary) for group in groups):
        return []
    # Distances from what groups say do not depend on the loss of the images.
    options = SolveOptions(**{**options.to_dict(), "loss": "squared", "loss_scale_px": 1.0})
    plain = LinearModel(problem, [_by_squares(g) for g in groups], options)
    sigmas = [_sigmas(rows, g.num_members) for rows, g in zip(plain.groups, groups, strict=True)]
    far = [k for k, of_members in enumerate(sigmas) if _distance(groups[k], of_members) > FAR_SIGMAS]
    robust = any(group.loss != _SQUARED for group in groups)
    pulls = _Pulls(LinearModel(problem, groups, options) if robust and far else plain)
    told = [_warning(groups[k], k, sigmas[k], pulls if whole else None) for k in far[:_MOST_WARNINGS]]
    left = len(far) - len(told)
    return told + [f"constraints: {left} more groups end as far from what they say"] * (left > 0)


def _may_be_far(group: Group, summary: Summary) -> bool:
    """Whether the cost of a group allows it to be far: cheap, and true for all that are."""
    cost = 2 * summary.constraint_costs.get(group.name, (0.0, 0.0))[1]
    if group.loss == _SQUARED:
        return cost > FAR_SIGMAS**2
    weighted = np.count_nonzero(np.atleast_2d(group.member_weights.T).any(axis=0))
    # The default scales are above one, and with a smaller scale a member costs less: a lower bound.
    scale = 1.0 if group.loss_scale is None else group.loss_scale
    of_far = _core.loss_terms(group.loss, scale, np.array([FAR_SIGMAS**2]))[0][0]
    return bool(cost > _FAR_SHARE * weighted * of_far)


def _by_squares(group: Group) -> Group:
    return group if group.loss == _SQUARED else replace(group, loss=_SQUARED, loss_scale=None)


def _sigmas(rows: ConstraintRows, count: int) -> FloatArray:
    """Distance (n,) of each member, in standard deviations by its weight; not a number without weight."""
    found = np.sqrt(rows.weight * np.bincount(rows.member, rows.errors**2, minlength=count))
    found[np.bincount(rows.member, minlength=count) == 0] = np.nan
    return np.asarray(found)


def _distance(group: Group, sigmas: FloatArray) -> float:
    """Distance that counts: of the worst member, but of the median where a loss allows for some."""
    known = sigmas[np.isfinite(sigmas)]
    if not len(known):
        return 0.0
    return float(known.max() if group.loss == _SQUARED else np.median(known))


class _Pulls:
    """What pulls at the members of groups at a minimum, where all gradients of the cost add up to zero."""

    def __init__(self, model: LinearModel) -> None:
        self._model = model
        self._size = model.num_columns
        # Columns have different units; over the stiffness that the groups give them they have none.
        self._stiffness = np.full(self._size, np.finfo(float).tiny)
        self._gradients = []
        for rows in model.groups:
            self._stiffness[: rows.columns] += rows.weight * rows.jacobian().power(2).sum(axis=0).A1
            self._gradients.append(self._gradient(rows, np.ones(len(rows.errors), dtype=bool)))

    def holding(self, group: int, member: int) -> Iterator[str]:
        """What holds a member of a group, in words."""
        rows = self._model.groups[group]
        own = self._gradient(rows, rows.member == member)
        squared = self._product(own, own)
        if squared == 0:
            yield "what is fixed"
            return
        shares = {f"{self._model.groups[k].name!r}": g for k, g in enumerate(self._gradients) if k != group}
        shares["its other members"] = self._gradients[group] - own
        found = {name: -self._product(own, gradient) / squared for name, gradient in shares.items()}
        found["the images"] = 1 - sum(found.values())
        for name in sorted(found, key=found.__getitem__, reverse=True)[:_MOST_WARNINGS]:
            if found[name] > _NAMED_SHARE:
                yield name

    def _gradient(self, rows: ConstraintRows, chosen: np.ndarray) -> FloatArray:
        found = np.zeros(self._size)
        found[: rows.columns] = rows.weight * (rows.jacobian().T @ np.where(chosen, rows.errors, 0.0))
        return found

    def _product(self, a: FloatArray, b: FloatArray) -> float:
        return float(np.sum(a * b / self._stiffness))


def _warning(group: Group, number: int, sigmas: FloatArray, pulls: _Pulls | None) -> str:
    name = f"constraints[{group.name!r}]"
    known = np.where(np.isfinite(sigmas), sigmas, 0.0)
    if group.loss != _SQUARED:
        return f"{name}: its median member ends {_distance(group, sigmas):,.0f} σ from what it says"
    worst = int(np.argmax(known))
    count = int((known > FAR_SIGMAS).sum())
    others = f" ({count:,} members end more than {FAR_SIGMAS:g} σ away)" if count > 1 else ""
    by = ", ".join(pulls.holding(number, worst)) if pulls is not None else ""
    held = f", held by {by}" if by else ""
    return f"{name}: member {worst} ends {known[worst]:,.0f} σ from what it says{held}{others}"
