"""Ground control points: a model moved and adjusted to surveyed points that are marked in its images.

The marked points are triangulated in the model as it is, a similarity moves it to where most of them agree
with the survey, and images, marks and survey are adjusted together. Check points are only compared.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from sfmcpp.ba.linearize import LinearModel
from sfmcpp.ba.options import takes_options
from sfmcpp.ba.time_limit import TimeLimit
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import (
    agreeing_pairs,
    fit_similarity,
    mean_reprojection_errors_px,
    triangulate_linear,
)
from sfmcpp.model import Problem, ResidualGroup
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray
from sfmcpp.model.checks import require_positive, require_seed
from sfmcpp.model.metadata import WorldOrigin
from sfmcpp.sensors.geocentric import doubt_of_geocentric
from sfmcpp.sensors.gps import doubt_of_radians
from sfmcpp.sfm.fit_statistics import cost_variance, linear_model
from sfmcpp.sfm.georeference import image_names, require_movable
from sfmcpp.sfm.mark_checks import mark_outside, warnings_about_marks
from sfmcpp.sfm.positions import is_on_a_line, local_positions, match_names
from sfmcpp.sources.io.control_points import SURVEY_SIGMA_M, ControlPoints, Mark
from sfmcpp.weighting import solve

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from sfmcpp._core import SolveKeywords

_FEWEST = 3
_FEWEST_MARKS = 2
# A control point so many of its own standard deviations off has a wrong number or a wrong mark.
_WRONG_SIGMAS = 4.0
# Above this leverage a point's residual says nothing of it.
_UNCHECKED = 0.9


@dataclass(frozen=True, eq=False)
class ControlOutcome:
    """How a model fits its ground control points, of g points.

    Attributes
    ----------
    names : list of str
        Of the points that at least two images of the model show.
    checks : (g,) bool
        Which of them are check points, that did not move the model.
    num_marks : (g,) int
        In how many images each is marked.
    offsets_m : (g, 3) float64
        Where the model has each minus where the survey has it, along the axes of the world [m].
    errors_px : (g,) float64
        Mean distance of its marks from its image [px].
    sigmas_off : (g,) float64
        The largest coordinate of its offset over the standard deviation of that; not a number for check
        points, and for coordinates that nothing else determines.
    left_out : list of str
        Points that fewer than two images show.
    world_origin : WorldOrigin
        Of the model now.
    warnings : list of str
        What may be wrong, in sentences.
    """

    names: list[str]
    checks: BoolArray
    num_marks: IndexArray
    offsets_m: FloatArray
    errors_px: FloatArray
    sigmas_off: FloatArray
    left_out: list[str]
    world_origin: WorldOrigin
    warnings: list[str] = field(default_factory=list)

    def rms_m(self, *, checks: bool) -> FloatArray | None:
        """Root mean squares (3,) of the offsets of control points, or of check points [m]; None without."""
        some = self.offsets_m[self.checks == checks]
        return np.sqrt(np.mean(some**2, axis=0)) if len(some) else None

    @property
    def mean_error_px(self) -> float:
        """Mean distance of all marks from the images of their points [px]."""
        known = np.isfinite(self.errors_px)
        marks = self.num_marks[known]
        return float(np.sum(marks * self.errors_px[known]) / marks.sum()) if known.any() else np.nan

    def moved(self, problem: Problem, by: FloatArray) -> ControlOutcome:
        """The outcome of a problem that a further solve has moved: offsets and errors follow, the rest stays.

        Parameters
        ----------
        problem : Problem
            As it is now, with the g surveyed points as its last.
        by : (g, 3) float64
            How far these have moved since [m].
        """
        marked = problem.with_points(np.arange(problem.num_points - len(self.names), problem.num_points))
        errors = mean_reprojection_errors_px(marked, marked.points)
        return replace(self, offsets_m=self.offsets_m + by, errors_px=errors)

    def to_dict(self) -> dict[str, Any]:
        """As plain values for a report."""
        rms = {f"rms_of_{what}s_m": self.rms_m(checks=what == "check") for what in ("control", "check")}
        points = [
            {
                "name": name,
                "check": bool(self.checks[k]),
                "marks": int(self.num_marks[k]),
                "offset_m": self.offsets_m[k].tolist(),
                "error_px": float(self.errors_px[k]),
                "sigmas_off": float(self.sigmas_off[k]) if np.isfinite(self.sigmas_off[k]) else None,
            }
            for k, name in enumerate(self.names)
        ]
        plain = {name: None if value is None else value.tolist() for name, value in rms.items()}
        told = {"origin": self.world_origin.to_dict(), "left_out": self.left_out, "warnings": self.warnings}
        return {"points": points, **plain, **told}


@dataclass(frozen=True, eq=False)
class Controlled:
    """A problem in the world of a survey.

    Attributes
    ----------
    problem : Problem
        Moved and adjusted, with the surveyed points as its last.
    outcome : ControlOutcome
        How it fits them.
    group : ResidualGroup
        The survey, for any later solve of the problem.
    """

    problem: Problem
    outcome: ControlOutcome
    group: ResidualGroup


@takes_options
def fit_control_points(
    problem: Problem,
    control: ControlPoints,
    *,
    sigma_m: float = SURVEY_SIGMA_M,
    seed: int = 0,
    **options: Unpack[SolveKeywords],
) -> Controlled:
    """Move and adjust a model to ground control points.

    Parameters
    ----------
    problem : Problem
        With a metric camera model; no camera or point fixed. It stays as it is.
    control : ControlPoints
        Surveyed points, at least three that are no check points and not on a line, each marked in at least
        two images of the model; see :func:`sfmcpp.sources.io.read_control_points`.
    sigma_m : float
        Standard deviation of each coordinate of the survey where it states none [m].
    seed : int
        Random seed of the search for points that agree.
    **options

    Returns
    -------
    Controlled
        The model in metres from the origin of the survey, and how it fits.

    Raises
    ------
    InvalidArgument
        If an argument breaks a rule, or too few points are marked, or they lie on a line.
    KeyboardInterrupt
        On Ctrl-C.
    """
    require_movable(problem)
    if not isinstance(control, ControlPoints):
        raise InvalidArgument(f"control = {control!r}: must be ControlPoints, as of read_control_points")
    require_positive("sigma_m", sigma_m)
    require_seed(seed)
    survey = _Survey.of(problem, control, sigma_m)
    numbers = np.arange(len(survey.names), dtype=np.int32) + problem.num_points
    joined = _with_marked_points(problem, survey, numbers)
    limit = TimeLimit(options.get("max_seconds"))
    summary = solve(joined, **options).require_uninterrupted()
    used = ~survey.checks
    _move(joined, joined.points[numbers[used]], survey.metres[used], seed)
    variance = cost_variance(linear_model(joined, [], dict(options), summary.loss_scale_px))
    group = _group(survey, numbers[used], variance)
    summary = solve(joined, constraints=[group], **limit.of(options)).require_uninterrupted()
    survey.origin.put_into(joined.metadata)
    model = linear_model(joined, [group], dict(options), summary.loss_scale_px)
    return Controlled(joined, _outcome(joined, survey, numbers, model), group)


@dataclass(frozen=True, eq=False)
class _Survey:
    """The points that can be used, in metres, and their marks by numbers of cameras and points."""

    names: list[str]
    metres: FloatArray
    sigmas_m: FloatArray
    checks: BoolArray
    origin: WorldOrigin
    cameras: IndexArray
    points: IndexArray
    pixels: FloatArray
    left_out: list[str]
    unseen: list[Mark]

    @classmethod
    def of(cls, problem: Problem, control: ControlPoints, sigma_m: float) -> _Survey:
        cameras = _cameras_of_marks(problem, control)
        shown = [mark for mark in control.marks if mark.image in cameras]
        seen = Counter(mark.point for mark in shown)
        kept = [point for point in range(len(control.names)) if seen[point] >= _FEWEST_MARKS]
        _require_enough(control, kept)
        rows = np.array(control.positions, dtype=np.float64)[kept]
        with _named_control():
            local = local_positions(rows, control.geodetic)
        if not local.known.all():
            name = control.names[kept[int(np.argmin(local.known))]]
            raise InvalidArgument(
                f"control: point {name!r} is at 0, 0, far from the others: must be where it was surveyed"
            )
        stated = control.sigmas_m or [(sigma_m,) * 3] * len(control.names)
        place = {point: k for k, point in enumerate(kept)}
        marks = [mark for mark in shown if mark.point in place]
        _require_inside(problem, control, marks, cameras)
        return cls(
            names=[control.names[point] for point in kept],
            metres=local.metres,
            sigmas_m=np.array(stated, dtype=np.float64)[kept],
            checks=np.isin(kept, list(control.checks)),
            origin=WorldOrigin(local.origin, local.geodetic),
            cameras=np.array([cameras[mark.image] for mark in marks], dtype=np.int32),
            points=np.array([place[mark.point] for mark in marks], dtype=np.int32),
            pixels=np.array([mark.pixel for mark in marks], dtype=np.float64),
            left_out=[name for point, name in enumerate(control.names) if point not in place],
            unseen=[mark for mark in control.marks if mark.image not in cameras],
        )


@contextmanager
def _named_control() -> Iterator[None]:
    """What is refused of positions in general is refused of the argument `control` here."""
    try:
        yield
    except InvalidArgument as error:
        raise InvalidArgument(f"control: {str(error).removeprefix('gps: ')}") from None


def _cameras_of_marks(problem: Problem, control: ControlPoints) -> dict[str, int]:
    """Cameras of the images that are named in marks, as far as the model has them."""
    names, wanted = image_names(problem), list(dict.fromkeys(mark.image for mark in control.marks))
    with _named_control():
        alike = match_names(names, wanted)
    if not alike:
        listed = ", ".join(wanted[:3]), ", ".join(names[:3])
        raise InvalidArgument(
            f"control: none of the marked images ({listed[0]}) is in the model ({listed[1]})"
        )
    return {alike[name]: camera for camera, name in enumerate(names) if name in alike}


def _require_inside(
    problem: Problem, control: ControlPoints, marks: list[Mark], cameras: dict[str, int]
) -> None:
    shown_by = np.array([cameras[mark.image] for mark in marks], dtype=np.int32)
    fault = mark_outside(problem, shown_by, np.array([mark.pixel for mark in marks], dtype=np.float64))
    if fault is not None:
        mark = marks[fault[0]]
        raise InvalidArgument(f"control: mark of {control.names[mark.point]!r} in {mark.image!r}: {fault[1]}")


def _require_enough(control: ControlPoints, kept: list[int]) -> None:
    used = [point for point in kept if point not in control.checks]
    if len(used) < _FEWEST:
        rule = f"{_FEWEST} are needed, each marked in {_FEWEST_MARKS} images of the model or more"
        raise InvalidArgument(f"control: {len(used)} control points can be used: {rule}")


def _with_marked_points(problem: Problem, survey: _Survey, numbers: IndexArray) -> Problem:
    """The model with the surveyed points where it has them itself."""
    marks = survey.cameras, survey.points, survey.pixels
    joined = problem.with_added_points(survey.metres, *marks)
    joined.points[numbers] = triangulate_linear(joined.with_points(numbers))
    lost = ~np.isfinite(joined.points[numbers]).all(axis=1)
    if lost.any():
        name = survey.names[int(np.argmax(lost))]
        raise InvalidArgument(f"control: the marks of point {name!r} do not determine where it is")
    return joined


def _move(problem: Problem, here: FloatArray, metres: FloatArray, seed: int) -> None:
    """Move a model so that most of its points `here` (n, 3) come to `metres` (n, 3)."""
    good = agreeing_pairs(here, metres, seed=seed)
    if is_on_a_line(metres[good]):
        raise InvalidArgument(
            "control: the points lie on a line, which leaves the model free to turn round it"
        )
    fit_similarity(here[good], metres[good]).move(problem)


def _group(survey: _Survey, numbers: IndexArray, variance: float) -> ResidualGroup:
    """The survey of the control points, beside observations whose variance is so many times the stated."""
    used = ~survey.checks
    metres, sigmas_m = survey.metres[used], survey.sigmas_m[used]
    by_point = np.einsum("ni,ij->nij", 1 / sigmas_m, np.eye(3))

    def offsets(points: FloatArray) -> tuple[FloatArray, FloatArray]:
        return (points - metres) / sigmas_m, by_point

    return ResidualGroup(offsets, points=numbers, weight=variance, name="control")


def _outcome(problem: Problem, survey: _Survey, numbers: IndexArray, model: LinearModel) -> ControlOutcome:
    offsets = problem.points[numbers] - survey.metres
    leverage = np.diag(model.hat_matrix(0)).reshape(-1, 3)
    used = ~survey.checks
    sigmas_off = np.full(len(numbers), np.nan)
    sigmas_off[used] = _largest_in_sigmas(offsets[used] / survey.sigmas_m[used], leverage)
    marked = problem.with_points(numbers)
    found = ControlOutcome(
        names=survey.names,
        checks=survey.checks,
        num_marks=np.bincount(survey.points, minlength=len(numbers)).astype(np.int32),
        offsets_m=offsets,
        errors_px=mean_reprojection_errors_px(marked, marked.points),
        sigmas_off=sigmas_off,
        left_out=survey.left_out,
        world_origin=survey.origin,
    )
    found.warnings.extend(
        warnings_about_marks(problem, len(survey.pixels), survey.names, image_names(problem))
    )
    found.warnings.extend(_about_unseen(survey.unseen))
    found.warnings.extend(_warnings(found, leverage))
    if survey.origin.geodetic:
        found.warnings.extend(doubt_of_radians(survey.origin.place, survey.metres))
    else:
        found.warnings.extend(doubt_of_geocentric(survey.metres + survey.origin.place))
    return found


def _largest_in_sigmas(whitened: FloatArray, leverage: FloatArray) -> FloatArray:
    """The largest coordinate (n,) of residuals (n, 3) over their own σ, √(1 − h)."""
    own = np.sqrt(np.maximum(1 - leverage, 1 - _UNCHECKED))
    ratios = np.where(leverage <= _UNCHECKED, np.abs(whitened) / own, np.nan)
    return np.where(np.isnan(ratios).all(axis=1), np.nan, np.nanmax(np.nan_to_num(ratios, nan=-1.0), axis=1))


def _about_unseen(unseen: list[Mark]) -> Iterator[str]:
    if unseen:
        listed = ", ".join(list(dict.fromkeys(mark.image for mark in unseen))[:3])
        yield f"marks in images that the model does not have are not used: {len(unseen)} ({listed})"


def _warnings(found: ControlOutcome, leverage: FloatArray) -> Iterator[str]:
    if found.left_out:
        listed = ", ".join(found.left_out[:3])
        rule = f"fewer than {_FEWEST_MARKS} images of the model show them"
        yield f"control points left out, as {rule}: {listed}"
    if np.isfinite(found.sigmas_off).any():
        worst = int(np.nanargmax(found.sigmas_off))
        sigmas = found.sigmas_off[worst]
        if sigmas > _WRONG_SIGMAS:
            yield (
                f"control point {found.names[worst]!r} is off by {sigmas:.1f} of its standard deviations: a "
                "wrong number or mark, swapped axes, or a survey less precise than stated"
            )
    unchecked = [
        name
        for name, h in zip(np.array(found.names)[~found.checks], leverage, strict=True)
        if h.max() > _UNCHECKED
    ]
    if unchecked:
        yield (
            f"nothing checks all coordinates of the control points {', '.join(unchecked[:3])}: a mistake "
            "there bends the model and does not show; more control or check points would show it"
        )
