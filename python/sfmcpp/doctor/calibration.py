"""Intrinsics that the images contradict, and intrinsics that they do not determine."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba import LinearModel
from sfmcpp.ba.doubtful_input import short_focal
from sfmcpp.doctor.case import Case, image_sizes_px
from sfmcpp.doctor.finding import Finding, numbers
from sfmcpp.doctor.trial import (
    Trial,
    adjusted,
    as_perspective,
    radii_px,
    redundancy,
    ridged_model,
    rows_seen,
)
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.pinhole import pinhole_rows
from sfmcpp.geometry.significance import mad_sigma
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray, largest_of_each
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.wording import counted

# Larger errors do not come from a lens that is merely simplified (no distortion, a centred principal point).
FOCAL_OFF, CENTRE_OFF = 0.1, 0.1
# No lens is off the middle by a fifth of the image; that of an image of half or twice the size is by more.
_OFF_MIDDLE = 0.2
# Sizes of images that a calibration may be of: this one, half of it, twice as large.
_SIZES = (1.0, 2.0, 0.5)
# A parameter that tells nothing lowers χ² by 1 in the mean; by so much (5 σ) it does not by chance.
_SIGNIFICANT = 25.0
# An intrinsic is not determined if one standard deviation of it moves the rim of the image by more than this
# share of its radius: two, the bounds at 95 %, reach the middle.
_HALF = 1 / 2
# A camera at the end of a road that cannot tell its own focal length hardly matters; half of them do.
_MOST = 0.5
# Terms of a lens stand in for each other: what one leaves open another takes up.
_LENS = ("k1", "k2", "k3", "k4", "k5", "p1", "p2")


def focal_signs(case: Case) -> Iterator[Finding]:
    """Find focal lengths that are not positive."""
    focals = pinhole_rows(case.problem.intrinsics)[case.problem.intrinsics_index, 0]
    cameras = numbers(np.flatnonzero((focals <= 0) & (case.views_of_cameras > 0)))
    if cameras:
        case.is_misread = True
        yield Finding(
            "focal-not-positive",
            "error",
            f"the focal length of {counted(len(cameras), 'camera')} is not positive: f = "
            f"{focals[cameras[0]]:g} px",
            "correct the program that wrote the intrinsics: a lens has f > 0, images upside down have "
            "negative y",
            case.named_cameras(cameras),
            cameras=cameras,
        )


def focal_unit(case: Case) -> Iterator[Finding]:
    """Find focal lengths that are in millimetres, or otherwise those of no lens."""
    if case.is_misread or (short := short_focal(case.problem, case.problem.intrinsics)) is None:
        return
    case.is_misread = True
    yield Finding(
        "short-focal",
        "error",
        short,
        "multiply f by the pixels per mm of the sensor, or take it from K or EXIF",
    )


def calibration(case: Case) -> Iterator[Finding]:
    """Find fixed focal lengths and principal points that the images contradict."""
    if case.is_misread or case.lacks_distortion or case.trial is None:
        return
    if not _may_be_tested(case.trial.problem):
        return
    found = list(_contradicted_intrinsics(case)) or list(_principal_points_near_border(case))
    case.blames_calibration = bool(found)
    yield from found


def _contradicted_intrinsics(case: Case) -> Iterator[Finding]:
    given = case.least_squares
    if given is None:
        return
    freed = adjusted_with_free_calibration(case, case.good_part)
    if freed is None or not is_significant(case, given, freed):
        return
    yield from _calibration_finding(case, median_calibration(given), median_calibration(freed), given, freed)


def median_calibration(trial: Trial) -> FloatArray:
    """(4,) the median f, aspect, cx, cy of the cameras that observe [px]."""
    rows = trial.problem.intrinsics_index[np.unique(trial.problem.camera_index)]
    return np.asarray(np.median(pinhole_rows(trial.problem.intrinsics)[rows, :4], axis=0))


def adjusted_with_free_calibration(case: Case, problem: Problem) -> Trial | None:
    """The adjustment with a free calibration, from that of an image of another size where it must be."""
    for scale in _SIZES:
        start = _with_free_calibration(problem)
        start.intrinsics[:, [0, 2, 3]] *= scale
        trial = adjusted(start, case.constraints, "squared")
        if not isinstance(trial, str) and not case.fits_poorly(trial):
            return trial
    return None


def _may_be_tested(problem: Problem) -> bool:
    return problem.camera_model != "bal" and bool(problem.fixed_intrinsics[:, 0].all())


def _with_free_calibration(problem: Problem) -> Problem:
    """The problem with f, cx and cy free, one row for all cameras that were given the same numbers."""
    rows, index = np.unique(as_perspective(problem).intrinsics, axis=0, return_inverse=True)
    return replace(
        problem,
        camera_model="perspective",
        intrinsics=rows,
        intrinsics_index=index.reshape(-1)[problem.intrinsics_index].astype(np.int32),
        fixed_intrinsics=np.tile([name not in ("f", "cx", "cy") for name in PERSPECTIVE], (len(rows), 1)),
    )


def is_significant(case: Case, given: Trial, freed: Trial, parameters: int = 3) -> bool:
    """Whether the squared error falls far more than by as many meaningless parameters per row in use."""
    squares = [case.squared_error(t) for t in (given, freed)]
    count = parameters * len(np.unique(freed.problem.intrinsics_index[freed.problem.camera_index]))
    return squares[0] - squares[1] > _SIGNIFICANT * count * squares[1] / redundancy(freed.problem)


def significantly_freed(
    case: Case, free: Callable[[Problem], Problem], parameters: int
) -> tuple[Trial, Trial, float] | None:
    """The least-squares trial, that with more intrinsics free, and by which part the squared error falls.

    None where either cannot be, or the fall is not significant for so many parameters per row in use.
    """
    given = case.least_squares
    if given is None:
        return None
    freed = adjusted(free(given.problem), case.constraints, "squared")
    if isinstance(freed, str) or not is_significant(case, given, freed, parameters):
        return None
    return given, freed, 1 - case.squared_error(freed) / case.squared_error(given)


def _calibration_finding(
    case: Case, before: FloatArray, after: FloatArray, given: Trial, freed: Trial
) -> Iterator[Finding]:
    ratio = float(after[0] / before[0])
    shift = after[2:] - before[2:]
    better = f" and reduces the median error from {given.median_px:.3g} to {freed.median_px:.3g} px"
    measures = {"focal_ratio": ratio, "shift_x_px": float(shift[0]), "shift_y_px": float(shift[1])}
    focal_off = abs(np.log(ratio)) > np.log1p(FOCAL_OFF)
    if focal_off and _fits_larger_image(case, given, freed, ratio):
        yield Finding(
            "calibration-of-another-size",
            "warning",
            f"K belongs to an image of another size: scaling f, cx and cy by {ratio:.3g} fits the "
            f"images{better}",
            f"multiply f, cx and cy by {ratio:.3g}",
            measures=measures,
        )
    elif focal_off and abs(np.log(ratio)) * before[0] > np.abs(shift).max():
        yield Finding(
            "wrong-focal",
            "warning",
            f"the fixed f = {before[0]:.5g} px contradicts the images: {after[0]:.5g} px fits them{better}",
            "check the unit of f and the image size it belongs to, or refine it (--refine f)",
            measures=measures,
        )
    elif np.abs(shift).max() > CENTRE_OFF * case.extent_px:
        yield Finding(
            "wrong-principal-point",
            "warning",
            f"the principal point ({before[2]:.5g}, {before[3]:.5g}) contradicts the images: "
            f"({after[2]:.5g}, {after[3]:.5g}) fits them{better}",
            "check the image size and whether the images were cropped",
            measures=measures,
        )


def _principal_points_near_border(case: Case) -> Iterator[Finding]:
    """Find principal points near the border where the images do not determine them, as on a straight road."""
    problem = case.sample
    rows = problem.intrinsics_index[problem.camera_index]
    given = np.median(problem.intrinsics[rows, 2:4], axis=0)
    middle = _image_centre_px(problem)
    if np.abs(given - middle).max() > _OFF_MIDDLE * case.extent_px:
        yield Finding(
            "principal-point-off-middle",
            "warning",
            f"the principal point ({given[0]:.5g}, {given[1]:.5g}) is far from the image centre "
            f"({middle[0]:.5g}, {middle[1]:.5g}): K belongs to an image of another size, or the images were "
            "cropped",
            "scale f, cx and cy to the image size, or give the principal point of the crop",
            measures={"shift_x_px": float(middle[0] - given[0]), "shift_y_px": float(middle[1] - given[1])},
        )


def _image_centre_px(problem: Problem) -> FloatArray:
    """The middle of the images by their sizes; else of the box around nearly all pixels [px]."""
    sizes = image_sizes_px(problem)
    if len(sizes):
        return np.asarray(np.median(sizes, axis=0) / 2)
    return np.asarray(np.quantile(problem.pixels, (0.01, 0.99), axis=0).mean(axis=0))


def _fits_larger_image(case: Case, given: Trial, freed: Trial, ratio: float) -> bool:
    """Whether, from where freedom led, all of K scaled fits better than the focal length alone."""
    whole, focal = (_with_free_calibration(given.problem).intrinsics for _ in range(2))
    whole[:, [0, 2, 3]] *= ratio
    focal[:, 0] *= ratio
    fixed = np.ones_like(freed.problem.fixed_intrinsics)
    squares = []
    for intrinsics in (whole, focal):
        start = replace(freed.problem, intrinsics=intrinsics, fixed_intrinsics=fixed)
        trial = adjusted(start, case.constraints, "squared")
        squares.append(np.inf if isinstance(trial, str) else case.squared_error(trial))
    return squares[0] < squares[1]


def undetermined(case: Case) -> Iterator[Finding]:
    """Find free intrinsics that the images do not determine."""
    trial = case.sound_trial
    if trial is None or trial.problem.fixed_intrinsics.all():
        return
    try:
        model = ridged_model(trial.problem, case.constraints)  # sensors are looked at by themselves
        cameras = _chosen_cameras(trial.problem)
        unknown = _undetermined_intrinsics(case, trial, model, cameras)
    except InvalidArgument as error:
        case.skipped.append(f"variances of intrinsics: {error}")
        return
    if unknown:
        yield _undetermined_finding(case, trial, unknown, len(cameras))


def _undetermined_intrinsics(
    case: Case, trial: Trial, model: LinearModel, cameras: IndexArray
) -> dict[str, tuple[float, IndexArray]]:
    """For each intrinsic that is open somewhere: its worst share of the radius, and the cameras."""
    sigmas = (
        trial.sigma_px
        / case.stated_sigma_px
        * np.sqrt(np.maximum(np.diagonal(model.covariance(cameras=cameras).cameras, axis1=1, axis2=2), 0))
    )
    reach = _largest_slopes(trial.problem, model)[cameras] * case.stated_sigma_px
    share = sigmas * reach / radii_px(trial.problem)[cameras, None]
    return {
        name: (float(share[:, column].max()), cameras[share[:, column] > _HALF])
        for column, name in enumerate(model.parameter_names)
        if column >= 6 and (share[:, column] > _HALF).any()
    }


def _chosen_cameras(problem: Problem) -> IndexArray:
    """One camera that observes for each row of intrinsics with something free."""
    rows, cameras = rows_seen(problem)
    return cameras[~problem.fixed_intrinsics[rows].all(axis=1)]


def _largest_slopes(problem: Problem, model: LinearModel) -> FloatArray:
    """(C, D) how far a parameter moves that observation of the camera that it moves most, per unit."""
    by_camera, _ = model.blocks()
    return largest_of_each(problem.camera_index, np.linalg.norm(by_camera, axis=1), problem.num_cameras)


def _undetermined_finding(
    case: Case, trial: Trial, unknown: dict[str, tuple[float, IndexArray]], tested: int
) -> Finding:
    cameras = np.unique(np.concatenate([cameras for _, cameras in unknown.values()]))
    listed = ", ".join(f"{name} (±{share:.0%})" for name, (share, _) in unknown.items())
    code, reason = _reason(trial, "f" in unknown)
    widespread = any(
        len(cameras) > _MOST * tested for name, (_, cameras) in unknown.items() if name not in _LENS
    )
    return Finding(
        code,
        "warning" if widespread else "note",
        f"the images do not determine {listed}: a change by one standard deviation moves pixels at the image "
        f"border by this fraction of the image radius{reason}",
        "fix them at known values (leave them out of --refine), or share them between cameras",
        case.named_cameras([int(k) for k in cameras]),
        cameras=tuple(int(k) for k in cameras),
        measures={name: share for name, (share, _) in unknown.items()},
    )


def _reason(trial: Trial, focal: bool) -> tuple[str, str]:
    problem = trial.problem
    seen = np.unique(problem.camera_index)
    if focal and _flatness_px(problem) < 3 * trial.sigma_px:
        return "planar-focal", "; all points are in one plane, which does not determine focal lengths"
    axes = problem.rotations[seen, :, 2]
    if focal and np.degrees(np.arccos(np.clip((axes @ axes.mean(axis=0)).min(), -1, 1))) < 5.0:
        return (
            "parallel-views",
            "; all cameras look in the same direction, which does not determine focal length and depth",
        )
    return "undetermined-intrinsics", ""


def _flatness_px(problem: Problem) -> float:
    """How thick the points are across the plane that fits them, seen from the median distance [px]."""
    seen: NDArray[np.int32] = np.unique(problem.point_index)
    offsets = problem.points[seen] - np.median(problem.points[seen], axis=0)
    normal = np.linalg.svd(offsets, full_matrices=False)[2][-1]
    rows = slice(None, None, max(1, problem.num_observations // 10_000))
    rays = problem.points[problem.point_index[rows]] - problem.centres[problem.camera_index[rows]]
    distance = float(np.median(np.linalg.norm(rays, axis=1)))
    focal = float(np.median(pinhole_rows(problem.intrinsics)[:, 0]))
    return mad_sigma(offsets @ normal) / distance * focal
