"""Conventions of pixels and poses: finds the known one that explains the data better."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from sfmcpp import _core
from sfmcpp.doctor.case import Case, extent_px, image_sizes_px
from sfmcpp.doctor.finding import Finding, numbers
from sfmcpp.doctor.trial import adjusted
from sfmcpp.geometry.pinhole import pinhole_rows
from sfmcpp.geometry.point_tests import depths, reprojection_errors_px
from sfmcpp.geometry.so3 import quaternion_from_rotation, rotation_from_quaternion
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.wording import counted

# A convention is said to be another if the median error falls to half with it: a start away from the truth is
# as far away under the right convention as under any other, and its errors come on top.
_BETTER = 2.0
# With a median error below this share of the image, the convention is right.
_FITS = 0.02
# Two that differ by less are equally good: a start away from the truth spreads their medians.
_AS_WELL = 1.2
# Half of all is what no outliers explain.
_MOST = 0.5
# Real sets of good repute have up to 0.3 % of their points behind a camera (BAL's Ladybug).
_NOTABLE_BEHIND = 0.01


@dataclass(frozen=True)
class Convention:
    """Another way in which a problem may have been written, and how it is read right."""

    code: str
    text: str
    read: Callable[[Problem], Problem]
    advice: str


def _with_pixels(
    change: Callable[[FloatArray, FloatArray], FloatArray],
    of_covariances: Callable[[FloatArray], FloatArray] | None = None,
) -> Callable[[Problem], Problem]:
    """Change pixels (M, 2), given the f, aspect, cx, cy, skew of each, and covariances with them."""

    def read(problem: Problem) -> Problem:
        rows = pinhole_rows(problem.intrinsics)[problem.intrinsics_index[problem.camera_index], :5]
        return _with_these_pixels(problem, change(problem.pixels, rows), of_covariances)

    return read


def _with_these_pixels(
    problem: Problem, pixels: FloatArray, of_covariances: Callable[[FloatArray], FloatArray] | None
) -> Problem:
    covariances = problem.covariance_px2
    if covariances is not None and of_covariances is not None:
        covariances = of_covariances(covariances)
    return replace(problem, pixels=pixels, covariance_px2=covariances)


def _mirrored(covariances: FloatArray) -> FloatArray:
    """Covariances (M, 2, 2) where one of the two axes points the other way."""
    return np.asarray(covariances * np.array([[1.0, -1.0], [-1.0, 1.0]]))


def _with_poses(
    change: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
) -> Callable[[Problem], Problem]:
    """Change rotations (C, 3, 3) and centres (C, 3)."""

    def read(problem: Problem) -> Problem:
        rotations, centres = change(problem.rotations, problem.centres)
        return replace(problem, cameras=np.concatenate([rotations, centres[:, :, None]], axis=2))

    return read


def _transposed(rotations: FloatArray) -> FloatArray:
    return np.swapaxes(rotations, 1, 2)


def _centres_of_translations(rotations: FloatArray, vectors: FloatArray) -> FloatArray:
    return np.asarray(-np.einsum("cij,cj->ci", rotations, vectors))


def _of_reordered_quaternions(rotations: FloatArray, centres: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Poses whose quaternions of camera_from_world, read as w, x, y, z, were written as x, y, z, w."""
    turned = _transposed(rotations)
    translations = _centres_of_translations(turned, centres)
    reordered = rotation_from_quaternion(quaternion_from_rotation(turned)[:, [3, 0, 1, 2]])
    return _transposed(reordered), _centres_of_translations(_transposed(reordered), translations)


def mirrored_y(problem: Problem) -> Problem:
    """The problem with pixels counted from the other edge: by the heights of the images, else around cy."""
    sizes = image_sizes_px(problem)
    if not len(sizes) or problem.camera_model == "bal":
        around_cy = _with_pixels(lambda x, k: np.column_stack([x[:, 0], 2 * k[:, 3] - x[:, 1]]), _mirrored)
        return around_cy(problem)
    pixels = np.column_stack([problem.pixels[:, 0], sizes[:, 1] - problem.pixels[:, 1]])
    return _with_these_pixels(problem, pixels, _mirrored)


def pixels_from_middle(problem: Problem) -> Problem:
    """The problem with pixels from the middle of the images, where all count from a corner and should not.

    The images are taken to be as large as their pixels tell, which is enough to judge by.
    """
    low, high = problem.pixels.min(axis=0), problem.pixels.max(axis=0)
    if pinhole_rows(problem.intrinsics)[:, 2:4].any() or ((low < 0) & (high > 0)).any():
        return problem
    return replace(problem, pixels=problem.pixels - (low + high) / 2)


def fy_for_aspect(problem: Problem) -> Problem:
    """The problem with its second intrinsic over the focal length, where it may be one.

    What is an aspect would become tiny, and all images lie near a line: nearer to the pixels than those of
    cameras that look elsewhere.
    """
    if "aspect" not in problem.intrinsic_names or not (problem.intrinsics[:, 1] > _core.LEAST_FY).all():
        return problem
    rows = problem.intrinsics.copy()
    rows[:, 1] /= rows[:, 0]
    return replace(problem, intrinsics=rows)


CONVENTIONS = (
    Convention(
        "mirrored-y",
        "the pixels' y points up instead of down",
        mirrored_y,
        "use --fix, or set v = height − v",
    ),
    Convention(
        "mirrored-x",
        "the images are mirrored left to right",
        _with_pixels(lambda x, k: np.column_stack([2 * k[:, 2] - x[:, 0], x[:, 1]]), _mirrored),
        "set u = width − u",
    ),
    Convention(
        "swapped-pixels",
        "the pixels are in the order (row, column) instead of (x, y)",
        _with_pixels(lambda x, k: x[:, ::-1].copy(), lambda c: c[:, ::-1, ::-1].copy()),
        "swap the two columns of the pixels",
    ),
    Convention(
        "centred-pixels",
        "the pixels are relative to the principal point instead of the corner of the image",
        _with_pixels(lambda x, k: x + k[:, 2:4]),
        "add (cx, cy) to the pixels, or set cx = cy = 0",
    ),
    Convention(
        "corner-pixels",
        "the pixels are relative to a corner of the image instead of the principal point",
        pixels_from_middle,
        "subtract (width / 2, height / 2) from the pixels; NVM files of COLMAP and OpenSfM are like that, "
        "others of theirs are not",
    ),
    Convention(
        "normalised-pixels",
        "the pixels are normalised image coordinates (at depth 1)",
        _with_pixels(lambda x, k: x * np.column_stack([k[:, 0], k[:, 0] * k[:, 1]]) + k[:, 2:4]),
        "multiply them by f and add (cx, cy), or set f = 1 and cx = cy = 0",
    ),
    Convention(
        "fy-for-aspect",
        "the second intrinsic is fy instead of the aspect ratio fy / fx",
        fy_for_aspect,
        "divide it by the first; the order is f, aspect, cx, cy, skew",
    ),
    Convention(
        "axes-of-opengl",
        "the cameras look along −z with y up (OpenGL, Bundler, BAL) instead of z with y down",
        _with_poses(lambda r, c: (r * np.array([1.0, -1.0, -1.0]), c)),
        "negate the second and third column of each rotation",
    ),
    Convention(
        "inverse-poses",
        "the poses are camera_from_world [R | t] instead of world_from_camera [R | c]",
        _with_poses(lambda r, c: (_transposed(r), _centres_of_translations(_transposed(r), c))),
        "invert the poses: R ← Rᵀ, c ← −Rᵀ t",
    ),
    Convention(
        "transposed-rotations",
        "the rotations are camera_from_world instead of world_from_camera; the centres are correct",
        _with_poses(lambda r, c: (_transposed(r), c)),
        "transpose the rotations",
    ),
    Convention(
        "translations-for-centres",
        "the last column holds the translations t of camera_from_world instead of centres",
        _with_poses(lambda r, c: (r, _centres_of_translations(r, c))),
        "set c ← −R t with R = world_from_camera",
    ),
    Convention(
        "centres-for-translations",
        "the centres were taken for translations t of camera_from_world",
        _with_poses(lambda r, c: (r, _centres_of_translations(_transposed(r), c))),
        "in the file, replace each centre c by t = −R c with R = camera_from_world",
    ),
    Convention(
        "quaternions-xyzw",
        "the quaternions of camera_from_world are in the order x, y, z, w instead of w, x, y, z",
        _with_poses(_of_reordered_quaternions),
        "in the file, put w first",
    ),
    Convention(
        "mirrored-world",
        "the points are in a left-handed frame",
        lambda p: replace(p, points=p.points * np.array([1.0, 1.0, -1.0])),
        "negate z of the points, or the axis in which the two frames differ",
    ),
)


def conventions(case: Case) -> Iterator[Finding]:
    """Find the convention that explains the observations far better than the one they were read by."""
    if case.is_misread or not case.problem.num_observations:
        return
    found = better_at_start(case) or _better_adjusted(case)
    if found is not None:
        case.is_misread = True
        convention, before, after = found
        yield Finding(
            convention.code,
            "error",
            f"{convention.text}: median error {_median_error_text(before)}, {after:.3g} px once corrected",
            convention.advice,
            measures={"median_px": before, "median_read_so_px": after},
        )


def _median_error_text(median_px: float) -> str:
    return (
        f"{median_px:.3g} px" if np.isfinite(median_px) else "infinite (most points are behind the cameras)"
    )


def better_at_start(case: Case) -> tuple[Convention, float, float] | None:
    """The convention that explains the start far better, and the median errors without and with it [px]."""
    median = float(np.median(case.errors_px))
    if median <= _FITS * case.extent_px:
        return None
    return _best_convention(case, median, lambda c: _median_px(c.read(case.sample)))


def _better_adjusted(case: Case) -> tuple[Convention, float, float] | None:
    """The convention from whose start an adjustment succeeds, where it fails without."""
    if case.trial is None or case.trial.median_px <= _FITS * case.extent_px:
        return None

    def after_adjustment(convention: Convention) -> float:
        trial = adjusted(convention.read(case.part))
        return np.inf if isinstance(trial, str) else trial.median_px

    return _best_convention(case, case.trial.median_px, after_adjustment)


def _best_convention(
    case: Case, before: float, judge: Callable[[Convention], float]
) -> tuple[Convention, float, float] | None:
    """The first of the conventions that fit best: symmetric scenes do not distinguish some of them."""
    medians = np.array([judge(convention) for convention in CONVENTIONS])
    best = int(np.argmax(medians <= _AS_WELL * medians.min()))
    extent = extent_px(CONVENTIONS[best].read(case.sample))
    if not medians[best] * _BETTER < before or medians[best] > extent / 4:
        return None
    return CONVENTIONS[best], before, float(medians[best])


def _median_px(problem: Problem) -> float:
    return float(np.median(reprojection_errors_px(problem, problem.points)))


def points_behind_cameras(case: Case) -> Iterator[Finding]:
    """Find observations of points behind the camera, and cameras that look away from most of theirs."""
    if case.is_misread or not case.problem.num_observations:
        return
    sample = case.sample
    is_behind = depths(sample, sample.points) <= 0
    share = float(is_behind.mean())
    views = np.bincount(sample.camera_index, minlength=sample.num_cameras)
    shares = np.bincount(sample.camera_index, is_behind, sample.num_cameras) / np.maximum(views, 1)
    away = numbers(np.flatnonzero(shares > _MOST))
    if away:
        yield Finding(
            "cameras-look-away",
            "warning",
            f"{counted(len(away), 'camera')} with more than half of the observed points behind",
            "estimate these poses again: the rotations point backwards, or the centres are beyond the points",
            case.named_cameras(away),
            cameras=away,
            measures={"share_behind": share},
        )
    elif is_behind.any():
        cameras = numbers(np.flatnonzero(shares > 0))
        yield Finding(
            "points-behind",
            "warning" if share > _NOTABLE_BEHIND else "note",
            f"{counted(int(is_behind.sum()), 'observation')} ({share:.2%}) of a point behind the camera",
            "triangulate these points again, or drop them: a step cannot move them through infinity",
            case.named_cameras(cameras),
            cameras=cameras,
            measures={"share_behind": share},
        )
