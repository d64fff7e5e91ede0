"""Safe repairs: duplicates, a mirrored y, disconnected parts, outliers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba.check import observations_without_image
from sfmcpp.doctor.case import Case, without_single_views
from sfmcpp.doctor.connections import parts
from sfmcpp.doctor.conventions import mirrored_y
from sfmcpp.doctor.diagnose import diagnose
from sfmcpp.doctor.duplicates import second_observations
from sfmcpp.doctor.finding import Finding
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.residual_group import Group


@dataclass(frozen=True)
class Repair:
    """A problem after its repair.

    Attributes
    ----------
    problem : Problem
        With all cameras and points, under the same indices, and fewer observations.
    done : list of str
        Repairs made, in order; empty: no finding has a safe repair.
    """

    problem: Problem
    done: list[str]


@checked()
def repair(problem: Problem, *, constraints: Iterable[Group] = ()) -> Repair:
    """Repair what can be repaired safely: duplicates, a mirrored y, disconnected parts, outliers.

    Repairs one fault at a time and diagnoses again after each. Cameras and points keep their indices: only
    observations are dropped, and a solve does not change cameras and points without observations. On the
    command line, points that have lost all theirs are left out of the file.

    Parameters
    ----------
    problem : Problem
        Not changed.
    constraints : iterable of ConstraintGroup or ResidualGroup
        Those of the solve.

    Returns
    -------
    Repair
        A new problem, and the repairs made.

    Raises
    ------
    InvalidArgument
        If a constraint is not a valid group.
    """
    groups, mended, done = list(constraints), problem.copy(), list[str]()
    tried = set[str]()
    while True:
        findings = diagnose(mended, constraints=groups).findings
        chosen = next((f for f in findings if f.code in _REPAIRS and f.code not in tried), None)
        if chosen is None:
            return Repair(mended, done)
        tried.add(chosen.code)
        before = mended.num_observations
        mended = _REPAIRS[chosen.code](mended, chosen, groups)
        dropped = before - mended.num_observations
        change = f"{dropped:,} of {before:,} observations dropped" if dropped else "y of all pixels mirrored"
        done.append(f"{chosen.code}: {change}")


_Mend = Callable[[Problem, Finding, list[Group]], Problem]


def _without_repeats(problem: Problem, _: Finding, __: list[Group]) -> Problem:
    return _without_observations(problem, second_observations(problem))


def _without_no_images(problem: Problem, _: Finding, __: list[Group]) -> Problem:
    return _without_observations(problem, observations_without_image(problem))


def _without_copied_cameras(problem: Problem, finding: Finding, _: list[Group]) -> Problem:
    return _without_observations(problem, np.flatnonzero(np.isin(problem.camera_index, finding.cameras)))


def _without_copied_points(problem: Problem, finding: Finding, _: list[Group]) -> Problem:
    return _without_observations(problem, np.flatnonzero(np.isin(problem.point_index, finding.points)))


def _mirrored(problem: Problem, _: Finding, __: list[Group]) -> Problem:
    return mirrored_y(problem)


def _largest_part(problem: Problem, _: Finding, groups: list[Group]) -> Problem:
    labels = parts(Case(problem, groups, None))
    return _without_observations(problem, np.flatnonzero(labels[problem.camera_index] != 0))


def _without_gross_errors(problem: Problem, _: Finding, groups: list[Group]) -> Problem:
    """Judged by the trial where it took the whole problem; of a large one, only the part it took."""
    case = Case(problem, groups, None)
    if case.trial is None:
        return problem
    wrong = case.given_rows(case.trial.problem, case.trial.gross(case.sigma_px))
    return without_single_views(_without_observations(problem, wrong))


def _without_observations(problem: Problem, rows: NDArray[np.integer]) -> Problem:
    return problem.with_observations(np.delete(np.arange(problem.num_observations), rows))


# In the order of the findings: what is there twice, then the convention, then what a trial tells.
_REPAIRS: dict[str, _Mend] = {
    "duplicate-observations": _without_repeats,
    "no-image": _without_no_images,
    "duplicate-cameras": _without_copied_cameras,
    "duplicate-points": _without_copied_points,
    "mirrored-y": _mirrored,
    "disconnected-parts": _largest_part,
    "outliers": _without_gross_errors,
}
