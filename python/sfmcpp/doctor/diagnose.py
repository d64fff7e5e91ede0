"""All examinations of a problem, in the order of cause and effect."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from sfmcpp import _core
from sfmcpp.ba import Summary, check
from sfmcpp.ba.arrays import core_arrays
from sfmcpp.doctor.calibration import calibration, focal_signs, focal_unit, undetermined
from sfmcpp.doctor.case import Case
from sfmcpp.doctor.configuration import angles, coincident_centres, pure_rotation, units
from sfmcpp.doctor.connections import connections
from sfmcpp.doctor.conventions import conventions, points_behind_cameras
from sfmcpp.doctor.distortion import distortion
from sfmcpp.doctor.duplicates import duplicate_observations, duplicates
from sfmcpp.doctor.finding import SEVERITIES, Diagnosis, Finding
from sfmcpp.doctor.gauge import gauge
from sfmcpp.doctor.held_intrinsics import held_intrinsics
from sfmcpp.doctor.image_scale import image_fill
from sfmcpp.doctor.initial_state import far_start, no_image
from sfmcpp.doctor.mounting import mounting
from sfmcpp.doctor.outliers import outliers, sigmas
from sfmcpp.doctor.principal_point import principal_point
from sfmcpp.doctor.rolling_shutter import rolling_shutter
from sfmcpp.doctor.solution import solution
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.camera_models import camera_model, is_pinhole
from sfmcpp.model.residual_group import Group, checked_groups

# Causes before what follows from them: of one severity, findings stay in this order.
_EXAMINATIONS: tuple[Callable[[Case], Iterator[Finding]], ...] = (
    focal_signs,
    focal_unit,
    coincident_centres,
    conventions,
    pure_rotation,
    units,
    duplicates,
    connections,
    points_behind_cameras,
    solution,
    image_fill,
    distortion,
    calibration,
    principal_point,
    rolling_shutter,
    held_intrinsics,
    undetermined,
    mounting,
    sigmas,
    outliers,
    far_start,
    angles,
    gauge,
)
# Those that ask neither for poses nor for lengths.
_OF_PROJECTIVE_CAMERAS = (duplicates, connections, gauge)
# Those that ask for no rays, which are known of pinholes alone.
_OF_RAYLESS_CAMERAS = (units, duplicates, connections, solution, gauge)


@checked()
def diagnose(
    problem: Problem, *, constraints: Iterable[Group] = (), summary: Summary | None = None
) -> Diagnosis:
    """Diagnose a problem: find what explains a bad result of a solve.

    Adjusts copies with a robust loss to separate gross errors from poor initial values; above 200 cameras or
    100,000 observations, copies of a part. The findings are the same in every run.

    Parameters
    ----------
    problem : Problem
        Not changed. Its state is the initial state of a solve, or with `summary` the final one.
    constraints : iterable of ConstraintGroup or ResidualGroup
        Those of the solve.
    summary : Summary, optional
        Result of the solve that ended in this state: variances, the worst parameters and other minima near
        the solution are then examined, too.

    Returns
    -------
    Diagnosis
        Findings, the most severe first, and skipped examinations.

    Raises
    ------
    InvalidArgument
        If a constraint is not a valid group, or its function does not return residuals. Errors of the problem
        itself are findings.
    KeyboardInterrupt
        On Ctrl-C, during adjustments too.
    """
    groups = checked_groups(constraints)
    refused = _invalid_arrays(problem)
    if refused is not None:
        return Diagnosis([refused], ["all other checks: an array is invalid"])
    problem = replace(problem)  # its fields may have been set since: lists, subclasses of arrays
    faulty = [*duplicate_observations(problem), *no_image(problem)]
    rows = np.setdiff1d(
        np.arange(problem.num_observations), [row for finding in faulty for row in finding.observations]
    )
    case = Case(problem.with_observations(rows) if faulty else problem, groups, summary, rows)
    findings = [*faulty, *_unsolvable(case)]
    with np.errstate(all="ignore"):  # numbers whose squares overflow are valid, and compare as infinite
        for examine in _examinations(case):
            findings += examine(case)
    findings.sort(key=lambda finding: SEVERITIES.index(finding.severity))
    return Diagnosis(findings, list(dict.fromkeys(case.skipped)))


def _examinations(case: Case) -> tuple[Callable[[Case], Iterator[Finding]], ...]:
    """The examinations that the camera model allows; what is left out is noted."""
    if not case.problem.is_metric:
        return _OF_PROJECTIVE_CAMERAS
    model = case.problem.camera_model
    if is_pinhole(model):
        return _EXAMINATIONS
    name = camera_model(model).name
    case.skipped.append(f"calibration, conventions, outliers, angles: no rays are known of {name!r} cameras")
    return _OF_RAYLESS_CAMERAS


def _invalid_arrays(problem: Problem) -> Finding | None:
    """Arrays that break a rule: numbers that are not finite, indices out of range, no rotations."""
    try:
        _core.residuals(core_arrays(problem))
    except InvalidArgument as error:
        return Finding(
            "invalid-array",
            "error",
            str(error),
            "correct the program that wrote the array: a solve refuses it",
        )
    return None


def _unsolvable(case: Case) -> Iterator[Finding]:
    """Sound arrays that make no problem: nothing observed, nothing free, fewer residuals than unknowns."""
    try:
        check(case.problem)
    except InvalidArgument as error:
        yield Finding("unsolvable", "error", str(error), "correct this first: a solve refuses the problem")
