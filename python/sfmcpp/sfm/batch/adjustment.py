"""Adjustment of a projective world until cameras, points and what counts as an inlier have settled."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from sfmcpp.ba import SolveOptions, adjust, projection_matrices, projective_problem
from sfmcpp.ba.image_frames import matrices_to_frames, matrices_to_pixels
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sfm.batch.cameras import resect
from sfmcpp.sfm.batch.measurements import Indices, Measurements
from sfmcpp.sfm.batch.structure import reprojection_errors_px, triangulate, without_worst

# Errors above this many robust standard deviations of one coordinate are outliers.
OUTLIER_SIGMAS = 5.0
# Median length of a normal deviate of two coordinates, σ = 1.
_MEDIAN_LENGTH = float(np.sqrt(2 * np.log(2.0)))
# What an image must see to stay: so many kept observations, and that share of the plausible ones.
_LEAST_SEEN, _LEAST_SHARE = 10, 0.3
_MOST_ROUNDS, _SETTLED = 10, 2e-3
_FIRST_LIMIT = 8.0
# From bent starts, long chains above all, Levenberg–Marquardt steps creep where those of the dog-leg do not.
_MOST_STEPS = 100
# Relative decrease of the cost at which adjustments end: those that others follow, and the last.
_COARSE, _FINE = 1e-4, 1e-6


@dataclass(frozen=True)
class ProjectivePlan:
    """How a projective world is adjusted.

    Attributes
    ----------
    max_error_px : float
        Observations off by more are left out, however large the noise is.
    min_limit_px : float
        Observations off by less are kept, however small the noise is.
    seed : int
        Of resections.
    threads : int
        Of the adjustments, 0 all; the same bits for any.
    """

    max_error_px: float
    min_limit_px: float
    seed: int
    threads: int


@dataclass(frozen=True, eq=False)
class World:
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


def first_world(
    measured: Measurements, cameras: FloatArray, plausible: BoolArray, plan: ProjectivePlan
) -> World:
    """Triangulate all tracks with the cameras of the factorisation; wide limits."""
    points = triangulate(measured, cameras, np.flatnonzero(plausible & _seen_by_known(measured, cameras)))
    error = reprojection_errors_px(measured, cameras, points)
    usual = float(np.median(error[plausible & np.isfinite(error)]))
    limit = max(_FIRST_LIMIT * plan.max_error_px, OUTLIER_SIGMAS * usual)
    points, kept = without_worst(measured, cameras, plausible, limit)
    return World(cameras, points, kept, usual / _MEDIAN_LENGTH)


def settled(measured: Measurements, world: World, plausible: BoolArray, plan: ProjectivePlan) -> World:
    """Adjust, drop and take up observations and images in turn, until nothing changes any more.

    Nothing is kept if too little agrees. The limit of what agrees comes down to the plan's by halves: what
    hangs on a part that is still bent must not be dropped before the adjustment has straightened it.
    """
    factor = _FIRST_LIMIT
    for _ in range(_MOST_ROUNDS):
        world = _without_poor_images(measured, world, plausible)
        world = _with_resected_images(measured, world, plausible, plan)
        if not _is_determined(measured, world):
            return replace(world, kept=np.zeros_like(world.kept))
        before, last = world.kept, factor <= 1
        world = _adjusted(measured, world, plan, _COARSE)
        factor = factor / 2
        world = _chosen_anew(measured, world, plausible, plan, factor)
        if last and np.count_nonzero(before != world.kept) <= _SETTLED * len(before):
            break
    return _adjusted(measured, world, plan, _FINE)


def problem_of(measured: Measurements, world: World) -> tuple[Problem, Indices, Indices, Indices]:
    """The problem of what is kept; the images, tracks and rows of the measurements it has."""
    rows = np.flatnonzero(world.kept)
    images, camera_index = np.unique(measured.image[rows], return_inverse=True)
    tracks, point_index = np.unique(measured.track[rows], return_inverse=True)
    matrices = matrices_to_pixels(world.cameras[images], measured.frames[images])
    problem = projective_problem(
        matrices, world.points[tracks], camera_index, point_index, measured.pixels[rows]
    )
    return problem, images, tracks, rows


def _adjusted(measured: Measurements, world: World, plan: ProjectivePlan, tolerance: float) -> World:
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


def _chosen_anew(
    measured: Measurements, world: World, plausible: BoolArray, plan: ProjectivePlan, factor: float
) -> World:
    """Choose the observations that agree by the noise as it is now, those left out before among them."""
    sigma = _sigma_px(measured, world)
    final = np.clip(OUTLIER_SIGMAS * sigma, plan.min_limit_px, plan.max_error_px)
    limit = max(float(final), factor * plan.max_error_px if factor > 1 else 0.0)
    error = reprojection_errors_px(measured, world.cameras, world.points)
    candidates = _seen_by_known(measured, world.cameras) & ((error < 2 * limit) | plausible)
    points, kept = without_worst(measured, world.cameras, candidates, limit)
    return World(world.cameras, points, kept, sigma)


def _is_determined(measured: Measurements, world: World) -> bool:
    """Whether observations are as many as unknowns; a camera has twelve, its scale among them."""
    images, tracks = (np.unique(of[world.kept]) for of in (measured.image, measured.track))
    return bool(0 < 12 * len(images) + 3 * len(tracks) <= 2 * np.count_nonzero(world.kept))


def _sigma_px(measured: Measurements, world: World) -> float:
    """Robust σ of a coordinate: what the fit leaves, over what it would leave of a unit variance."""
    error = reprojection_errors_px(measured, world.cameras, world.points)[world.kept]
    equations = 2 * len(error)
    unknowns = 3 * len(np.unique(measured.track[world.kept])) + 11 * int(world.known.sum())
    left = max(equations - unknowns, 1) / equations
    return float(np.median(error) / _MEDIAN_LENGTH / np.sqrt(left))


def _seen_by_known(measured: Measurements, cameras: FloatArray) -> BoolArray:
    return np.asarray(np.isfinite(cameras[measured.image, 0, 0]))


def _without_poor_images(measured: Measurements, world: World, trusted: BoolArray) -> World:
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
    measured: Measurements, world: World, plausible: BoolArray, plan: ProjectivePlan
) -> World:
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
