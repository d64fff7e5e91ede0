"""The adjusted problem once more, with all intrinsics free that it holds, and how well images tell them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from sfmcpp.ba import LinearModel, SolveOptions
from sfmcpp.doctor.trial import (
    RIDGE,
    Trial,
    adjusted,
    as_perspective,
    moved_at_border,
    radii_px,
    redundancy,
    with_free_sensors,
)
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray, largest_of_each
from sfmcpp.model.camera_models import PERSPECTIVE, is_pinhole

if TYPE_CHECKING:
    from sfmcpp.doctor.case import Case

TESTED = ("f", "aspect", "cx", "cy", "k1")
_F = PERSPECTIVE.index("f")


@dataclass(frozen=True, eq=False)
class FreedIntrinsics:
    """The least-squares trial once more, with all held intrinsics free.

    Cameras whose intrinsics are the same numbers share a row here.

    Attributes
    ----------
    given, freed : Trial
        Adjusted with the intrinsics held, and from there with them free.
    columns : (n,) int
        Columns of the intrinsics that were held and are free.
    rows, cameras : (k,) int
        Rows of intrinsics that are observed, and a camera of each.
    sigmas : (k, n) float64
        Standard deviations of the estimates by the scatter of the residuals.
    variance_px2 : float
        This scatter [px²].
    """

    given: Trial
    freed: Trial
    columns: IndexArray
    rows: IndexArray
    cameras: IndexArray
    sigmas: FloatArray
    variance_px2: float

    @cached_property
    def before(self) -> FloatArray:
        """(k, n) values they were held at."""
        held = as_perspective(self.given.problem).intrinsics
        return np.asarray(held[self.given.problem.intrinsics_index[self.cameras]][:, self.columns])

    @cached_property
    def after(self) -> FloatArray:
        """(k, n) values that the images prefer."""
        return np.asarray(self.freed.problem.intrinsics[self.rows][:, self.columns])

    @cached_property
    def moved(self) -> FloatArray:
        """(k, n) part of the image's radius by which the change of each moves pixels at the border."""
        problem = self.freed.problem
        radius = largest_of_each(problem.intrinsics_index, radii_px(problem), len(problem.intrinsics))
        radii, focals = radius[self.rows], problem.intrinsics[self.rows, _F]
        scale = np.stack([moved_at_border(int(column), focals, radii) for column in self.columns], axis=1)
        return np.asarray(np.abs(self.after - self.before) * scale)


def freed_intrinsics(case: Case) -> FreedIntrinsics | None:
    """Free all held intrinsics of the trial; None, the reason noted, where that tells nothing."""
    trial = case.trial
    if case.is_misread or trial is None or case.fits_poorly(trial) or not _may_be_tested(trial.problem):
        return None
    given = case.least_squares
    columns = _held_columns(trial.problem)
    if given is None or not len(columns):
        return None
    freed = adjusted(_with_free(given.problem, columns), case.constraints, "squared")
    if isinstance(freed, str) or case.squared_error(freed) > case.squared_error(given):
        return None
    try:
        return _with_sigmas(case, given, freed, columns)
    except InvalidArgument as error:
        case.skipped.append(f"held intrinsics: {error}")
        return None


def _may_be_tested(problem: Problem) -> bool:
    return problem.camera_model != "bal" and is_pinhole(problem.camera_model)


def _held_columns(problem: Problem) -> IndexArray:
    """Columns of TESTED that are held for all cameras that observe."""
    rows = np.unique(problem.intrinsics_index[problem.camera_index])
    fixed = as_perspective(problem).fixed_intrinsics[rows]
    return np.array([k for k in map(PERSPECTIVE.index, TESTED) if fixed[:, k].all()], dtype=np.int32)


def _with_free(problem: Problem, columns: IndexArray) -> Problem:
    """The problem with these columns free, too; rows of the same numbers and freedom become one."""
    problem = as_perspective(problem)
    problem.fixed_intrinsics[:, columns] = False
    both = np.concatenate([problem.intrinsics, problem.fixed_intrinsics], axis=1)
    rows, index = np.unique(both, axis=0, return_inverse=True)
    return replace(
        problem,
        intrinsics=rows[:, : len(PERSPECTIVE)].copy(),
        fixed_intrinsics=rows[:, len(PERSPECTIVE) :] != 0,
        intrinsics_index=index.reshape(-1)[problem.intrinsics_index].astype(np.int32),
    )


def _with_sigmas(case: Case, given: Trial, freed: Trial, columns: IndexArray) -> FreedIntrinsics:
    problem = freed.problem
    seen = np.unique(problem.camera_index)
    rows, first = np.unique(problem.intrinsics_index[seen], return_index=True)
    cameras = seen[first].astype(np.int32)
    # Sensors are looked at by themselves.
    model = LinearModel(with_free_sensors(problem), case.constraints, SolveOptions(gauge="fixed"), RIDGE)
    places = [model.parameter_names.index(PERSPECTIVE[k]) for k in columns]
    blocks = np.diagonal(model.covariance(cameras=cameras).cameras, axis1=1, axis2=2)[:, places]
    variance = case.squared_error(freed) / redundancy(problem, blocks.size)
    scale = variance / case.stated_sigma_px**2
    sigmas = np.sqrt(np.maximum(blocks, 0) * scale)
    return FreedIntrinsics(
        given, freed, columns, rows.astype(np.int32), cameras, np.asarray(sigmas), float(variance)
    )
