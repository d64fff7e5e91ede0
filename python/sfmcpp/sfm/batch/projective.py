"""Projective reconstruction from tracks with missing data (thesis §3.3.1, algorithm 4, first half)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba import SolveOptions, adjust, projection_matrices, projective_problem
from sfmcpp.ba.projective import matrices_to_frames, matrices_to_pixels
from sfmcpp.geometry.significance import MEDIAN_LENGTH
from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_count, require_positive, require_seed
from sfmcpp.model.image_tracks import ImageTracks
from sfmcpp.sfm.batch.blocks import factorised_blocks
from sfmcpp.sfm.batch.constraints import connected_blocks, joint_cameras
from sfmcpp.sfm.batch.direct_linear import (
    reprojection_errors_px,
    resect,
    triangulate,
    triangulate_without_outliers,
)
from sfmcpp.sfm.batch.measurements import Indices, Measurements, normalised_measurements
from sfmcpp.sfm.batch.pairs import pair_geometries, plausible_observations

# Errors above this many robust standard deviations of one coordinate are outliers.
OUTLIER_SIGMAS = 5.0
# Observations off by less are none, however small the noise is [px].
_LEAST_LIMIT_PX = 0.5
# What an image must see to stay: so many kept observations, and that share of the plausible ones.
_LEAST_SEEN, _LEAST_SHARE = 10, 0.3
_MAX_ROUNDS, _SETTLED = 10, 2e-3
_FIRST_LIMIT = 8.0
# From bent starts, long chains above all, Levenberg–Marquardt steps creep where those of the dog-leg do not.
_MOST_STEPS = 100
# Relative decrease of the cost at which adjustments end: those that others follow, and the last.
_COARSE, _FINE = 1e-4, 1e-6


@dataclass(frozen=True, eq=False)
class ProjectiveReconstruction:
    """Cameras and points up to a homography of the world, or why there are none.

    Attributes
    ----------
    problem : Problem or None
        Camera model ``"projective"``: the images that have a camera, the tracks that have a point and the
        observations that agree; names and sizes of the images in its metadata. None after a failure.
    images : (C,) int64
        Image of each camera.
    tracks : (N,) int64
        Track of each point.
    observations : (M,) int64
        Row of each observation in the tracks that were given.
    sigma_px : float
        Robust standard deviation of a coordinate of an observation, freed of what the fit absorbs [px].
    left_out : dict
        Why an image has no camera, by its number.
    message : str
        Why there is no reconstruction; empty if there is one.
    """

    problem: Problem | None
    images: NDArray[np.int64]
    tracks: NDArray[np.int64]
    observations: NDArray[np.int64]
    sigma_px: float
    left_out: dict[int, str]
    message: str = ""


def reconstruct_projective(
    tracks: ImageTracks,
    *,
    max_error_px: float = 4.0,
    adjusted: bool = True,
    seed: int = 0,
    threads: int = 0,
) -> ProjectiveReconstruction:
    """Reconstruct cameras and points from tracks alone, up to a homography (thesis algorithm 4).

    Fundamental matrices tell plausible observations; full sub-matrices of the rescaled measurement matrix are
    factorised, their depths chained by epipolar geometry; their bases constrain all cameras at once; points
    are triangulated, and everything is adjusted, T-ALS along the steps, until the inliers have settled.

    Parameters
    ----------
    tracks : ImageTracks
        What images see; wrong observations among the right ones.
    max_error_px : float
        Observations off by more are outliers, as are those off by more than five robust standard
        deviations [px].
    adjusted : bool
        False: the linear solution, as an adjustment finds it, with generous limits of outliers.
    seed : int
        Same seed, same result.
    threads : int
        Of the adjustments, 0 all; the same bits for any.

    Returns
    -------
    ProjectiveReconstruction
        Of the largest set of images that hang together.

    Raises
    ------
    InvalidArgument
        If a number is out of its range.
    ModuleNotFoundError
        If PoseLib is not installed (extra ``vision``).
    """
    require_positive("max_error_px", max_error_px)
    require_seed(seed)
    require_count("threads", threads, 0)
    plan = ProjectivePlan(max_error_px, seed, threads)
    measured, order = normalised_measurements(
        tracks.image_index, tracks.track_index, tracks.pixels, tracks.num_images
    )
    pairs = pair_geometries(measured, max_error_px / 2, seed)
    if not pairs:
        return _failed_result(
            tracks, "no two images share enough tracks consistent with an epipolar geometry"
        )
    plausible = plausible_observations(measured, pairs)
    blocks = factorised_blocks(measured, pairs, plausible, max_error_px / 2)
    if not blocks:
        return _failed_result(tracks, "no three images share enough consistent tracks")
    cameras = joint_cameras(*connected_blocks(blocks), tracks.num_images)
    world = initial_world(measured, cameras, plausible, plan)
    if adjusted:
        world = adjusted_until_settled(measured, world, plausible, plan)
    if not world.kept.any():
        return _failed_result(tracks, "too few tracks of every image are consistent with the factorisation")
    return _successful_result(tracks, measured, world, plausible, order)


def _successful_result(
    tracks: ImageTracks,
    measured: Measurements,
    world: ProjectiveWorld,
    plausible: BoolArray,
    order: NDArray[np.int64],
) -> ProjectiveReconstruction:
    problem, images, kept_tracks, rows = problem_of(measured, world)
    problem.metadata = Metadata(
        image_names=[tracks.names[image] for image in images.tolist()], image_sizes=tracks.sizes[images]
    )
    seen = np.bincount(measured.image, minlength=tracks.num_images)
    good = np.bincount(measured.image[plausible], minlength=tracks.num_images)
    missing = sorted(set(range(tracks.num_images)) - set(images.tolist()))
    left_out = {image: _reason_without_camera(int(seen[image]), int(good[image])) for image in missing}
    return ProjectiveReconstruction(problem, images, kept_tracks, order[rows], world.sigma_px, left_out)


def _reason_without_camera(seen: int, plausible: int) -> str:
    if not plausible:
        return f"none of its {seen} tracks is consistent with another image"
    return f"too few of its {plausible} plausible tracks are consistent with the cameras of the other images"


def _failed_result(tracks: ImageTracks, message: str) -> ProjectiveReconstruction:
    none = np.empty(0, dtype=np.int64)
    left_out = dict.fromkeys(range(tracks.num_images), message)
    return ProjectiveReconstruction(None, none, none, none, float("nan"), left_out, message)


@dataclass(frozen=True)
class ProjectivePlan:
    """How a projective world is adjusted.

    Attributes
    ----------
    max_error_px : float
        Observations off by more are left out, however large the noise is.
    seed : int
        Of resections.
    threads : int
        Of the adjustments, 0 all; the same bits for any.
    """

    max_error_px: float
    seed: int
    threads: int


@dataclass(frozen=True, eq=False)
class ProjectiveWorld:
    """A projective world in progress.

    Attributes
    ----------
    cameras : (C, 3, 4) float64
        To the frames of the images; nan where unknown.
    points : (N, 4) float64
        Nan where unknown.
    kept : (M,) bool
        Observations that agree.
    sigma_px : float
        Robust standard deviation of a coordinate of an observation [px].
    """

    cameras: FloatArray
    points: FloatArray
    kept: BoolArray
    sigma_px: float = field(default=np.nan)

    @property
    def known(self) -> BoolArray:
        """(C,) images with a camera."""
        return np.isfinite(self.cameras[:, 0, 0])


def initial_world(
    measured: Measurements, cameras: FloatArray, plausible: BoolArray, plan: ProjectivePlan
) -> ProjectiveWorld:
    """Triangulate all tracks with the cameras of the factorisation; wide limits."""
    points = triangulate(measured, cameras, np.flatnonzero(plausible & _seen_by_known(measured, cameras)))
    error = reprojection_errors_px(measured, cameras, points)
    usual = float(np.median(error[plausible & np.isfinite(error)]))
    limit = max(_FIRST_LIMIT * plan.max_error_px, OUTLIER_SIGMAS * usual)
    points, kept = triangulate_without_outliers(measured, cameras, plausible, limit)
    return ProjectiveWorld(cameras, points, kept, usual / MEDIAN_LENGTH)


def adjusted_until_settled(
    measured: Measurements, world: ProjectiveWorld, plausible: BoolArray, plan: ProjectivePlan
) -> ProjectiveWorld:
    """Adjust, drop and take up observations and images in turn, until nothing changes any more.

    Nothing is kept if too little agrees. The limit of what agrees comes down to the plan's by halves: what
    hangs on a part that is still bent must not be dropped before the adjustment has straightened it.
    """
    factor = _FIRST_LIMIT
    for _ in range(_MAX_ROUNDS):
        world = _without_poor_images(measured, world, plausible)
        world = _with_resected_images(measured, world, plausible, plan)
        if not _is_determined(measured, world):
            return replace(world, kept=np.zeros_like(world.kept))
        before, last = world.kept, factor <= 1
        world = _adjusted_world(measured, world, plan, _COARSE)
        factor = factor / 2
        world = _with_updated_inliers(measured, world, plausible, plan, factor)
        if last and np.count_nonzero(before != world.kept) <= _SETTLED * len(before):
            break
    return _adjusted_world(measured, world, plan, _FINE)


def problem_of(measured: Measurements, world: ProjectiveWorld) -> tuple[Problem, Indices, Indices, Indices]:
    """The problem of what is kept; the images, tracks and rows of the measurements it has."""
    rows = np.flatnonzero(world.kept)
    images, camera_index = np.unique(measured.image[rows], return_inverse=True)
    tracks, point_index = np.unique(measured.track[rows], return_inverse=True)
    matrices = matrices_to_pixels(world.cameras[images], measured.frames[images])
    problem = projective_problem(
        matrices, world.points[tracks], camera_index, point_index, measured.pixels[rows]
    )
    return problem, images, tracks, rows


def _adjusted_world(
    measured: Measurements, world: ProjectiveWorld, plan: ProjectivePlan, tolerance: float
) -> ProjectiveWorld:
    problem, images, tracks, _ = problem_of(measured, world)
    scale = min(max(2 * world.sigma_px, 0.1), plan.max_error_px)
    options = SolveOptions(
        method="dog-leg",
        line_search="t-als",
        loss="huber",
        loss_scale_px=scale,
        max_iterations=_MOST_STEPS,
        function_tolerance=tolerance,
        threads=plan.threads,
    )
    adjust(problem, [], options)
    cameras, points = world.cameras.copy(), np.full_like(world.points, np.nan)
    cameras[images] = matrices_to_frames(projection_matrices(problem), measured.frames[images])
    cameras[images] /= np.linalg.norm(cameras[images], axis=(1, 2), keepdims=True)
    points[tracks] = problem.points
    return replace(world, cameras=cameras, points=points)


def _with_updated_inliers(
    measured: Measurements, world: ProjectiveWorld, plausible: BoolArray, plan: ProjectivePlan, factor: float
) -> ProjectiveWorld:
    """Choose the observations that agree by the noise as it is now, those left out before among them."""
    sigma = _sigma_px(measured, world)
    final = np.clip(OUTLIER_SIGMAS * sigma, _LEAST_LIMIT_PX, plan.max_error_px)
    limit = max(float(final), factor * plan.max_error_px if factor > 1 else 0.0)
    error = reprojection_errors_px(measured, world.cameras, world.points)
    candidates = _seen_by_known(measured, world.cameras) & ((error < 2 * limit) | plausible)
    points, kept = triangulate_without_outliers(measured, world.cameras, candidates, limit)
    return ProjectiveWorld(world.cameras, points, kept, sigma)


def _is_determined(measured: Measurements, world: ProjectiveWorld) -> bool:
    """Whether observations are as many as unknowns; a camera has twelve, its scale among them."""
    images, tracks = (np.unique(of[world.kept]) for of in (measured.image, measured.track))
    return bool(0 < 12 * len(images) + 3 * len(tracks) <= 2 * np.count_nonzero(world.kept))


def _sigma_px(measured: Measurements, world: ProjectiveWorld) -> float:
    """Robust σ of a coordinate: what the fit leaves, over what it would leave of a unit variance."""
    error = reprojection_errors_px(measured, world.cameras, world.points)[world.kept]
    equations = 2 * len(error)
    unknowns = 3 * len(np.unique(measured.track[world.kept])) + 11 * int(world.known.sum())
    left = max(equations - unknowns, 1) / equations
    return float(np.median(error) / MEDIAN_LENGTH / np.sqrt(left))


def _seen_by_known(measured: Measurements, cameras: FloatArray) -> BoolArray:
    return np.asarray(np.isfinite(cameras[measured.image, 0, 0]))


def _without_poor_images(
    measured: Measurements, world: ProjectiveWorld, trusted: BoolArray
) -> ProjectiveWorld:
    count = measured.num_images
    seen = np.bincount(measured.image[world.kept], minlength=count)
    expected = np.bincount(measured.image[trusted], minlength=count)
    poor = world.known & ((seen < _LEAST_SEEN) | (seen < _LEAST_SHARE * expected))
    cameras = np.where(poor[:, None, None], np.nan, world.cameras)
    kept = world.kept & ~poor[measured.image]
    kept &= np.bincount(measured.track[kept], minlength=measured.num_tracks)[measured.track] >= 2
    points = world.points.copy()
    points[np.bincount(measured.track[kept], minlength=measured.num_tracks) < 2] = np.nan
    return replace(world, cameras=cameras, points=points, kept=kept)


def _with_resected_images(
    measured: Measurements, world: ProjectiveWorld, plausible: BoolArray, plan: ProjectivePlan
) -> ProjectiveWorld:
    """Give a camera to every image without one that sees enough known points."""
    cameras, kept = world.cameras.copy(), world.kept.copy()
    for image in np.flatnonzero(~world.known).tolist():
        rows = measured.rows_of(image)
        rows = rows[np.isfinite(world.points[measured.track[rows], 0])]
        if len(rows) < _LEAST_SEEN:
            continue
        limit = plan.max_error_px / measured.frames[image, 0]
        camera, good = resect(measured.rays[rows], world.points[measured.track[rows]], limit, plan.seed)
        if good.sum() < max(_LEAST_SEEN, _LEAST_SHARE * plausible[rows].sum()):
            continue
        cameras[image] = camera
        kept[rows[good]] = True
    return replace(world, cameras=cameras, kept=kept)
