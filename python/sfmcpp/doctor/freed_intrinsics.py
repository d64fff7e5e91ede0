"""The adjusted problem once more, with all intrinsics free that it holds, and how well images tell them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from sfmcpp.doctor.trial import (
    Trial,
    adjusted,
    as_perspective,
    may_be_perspective,
    moved_at_border,
    radii_px,
    redundancy,
    ridged_model,
    rows_seen,
)
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray, largest_of_each
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.model.residual_group import Group

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


def held_columns(problem: Problem) -> IndexArray:
    """Columns of TESTED that are held for all cameras that observe; none where a camera model has others."""
    if not may_be_perspective(problem):
        return np.zeros(0, dtype=np.int32)
    rows = np.unique(problem.intrinsics_index[problem.camera_index])
    fixed = as_perspective(problem).fixed_intrinsics[rows]
    return np.array([k for k in map(PERSPECTIVE.index, TESTED) if fixed[:, k].all()], dtype=np.int32)


def freed_intrinsics(
    given: Trial, columns: IndexArray, constraints: Sequence[Group], extent_px: float, sigma_px: float
) -> FreedIntrinsics | str | None:
    """Free some held intrinsics of a trial.

    Parameters
    ----------
    given : Trial
        Adjusted by least squares.
    columns : (n,) int
        The columns of its intrinsics to free.
    constraints : sequence of ConstraintGroup or ResidualGroup
        Those it was adjusted with.
    extent_px : float
        Extent of the images [px].
    sigma_px : float
        Median stated standard deviation of the pixels [px].

    Returns
    -------
    FreedIntrinsics, str or None
        None where the adjustment fails or fits worse; a text with the reason where nothing determines them.
    """
    freed = adjusted(_with_free(given.problem, columns), constraints, "squared")
    if isinstance(freed, str) or freed.squared_error(extent_px) > given.squared_error(extent_px):
        return None
    rows, cameras = rows_seen(freed.problem)
    try:
        variances = _variances(freed.problem, columns, cameras, constraints)
    except InvalidArgument as error:
        return str(error)
    variance_px2 = freed.squared_error(extent_px) / redundancy(freed.problem, variances.size)
    sigmas = np.sqrt(np.maximum(variances, 0) * (variance_px2 / sigma_px**2))
    return FreedIntrinsics(given, freed, columns, rows, cameras, np.asarray(sigmas), float(variance_px2))


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


def _variances(
    problem: Problem, columns: IndexArray, cameras: IndexArray, constraints: Sequence[Group]
) -> FloatArray:
    """(k, n) variances of these intrinsics of these cameras for the stated σ of the pixels."""
    model = ridged_model(problem, constraints)  # sensors are looked at by themselves
    places = [model.parameter_names.index(PERSPECTIVE[k]) for k in columns]
    return np.diagonal(model.covariance(cameras=cameras).cameras, axis1=1, axis2=2)[:, places]
