"""From tracks with missing data to a projective reconstruction (thesis §3.3.1, algorithm 4, first half)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import Metadata, Problem
from sfmcpp.model.arrays import BoolArray
from sfmcpp.model.checks import require_count, require_positive, require_seed
from sfmcpp.model.image_tracks import ImageTracks
from sfmcpp.sfm.batch.adjustment import ProjectivePlan, World, first_world, problem_of, settled
from sfmcpp.sfm.batch.blocks import factorised_blocks
from sfmcpp.sfm.batch.constraints import connected_blocks, joint_cameras
from sfmcpp.sfm.batch.measurements import Measurements, measure
from sfmcpp.sfm.batch.pairs import pair_geometries, plausible_observations


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
    min_limit_px: float = 0.5,
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
    min_limit_px : float
        Observations off by less are none, however small the noise is [px].
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
    require_positive("min_limit_px", min_limit_px)
    require_seed(seed)
    require_count("threads", threads, 0)
    plan = ProjectivePlan(max_error_px, min(min_limit_px, max_error_px), seed, threads)
    measured, order = measure(tracks.image_index, tracks.track_index, tracks.pixels, tracks.num_images)
    pairs = pair_geometries(measured, max_error_px / 2, seed)
    if not pairs:
        return _failed(tracks, "no two images share enough tracks consistent with an epipolar geometry")
    plausible = plausible_observations(measured, pairs)
    blocks = factorised_blocks(measured, pairs, plausible, max_error_px / 2)
    if not blocks:
        return _failed(tracks, "no three images share enough consistent tracks")
    cameras = joint_cameras(*connected_blocks(blocks), tracks.num_images)
    world = first_world(measured, cameras, plausible, plan)
    if adjusted:
        world = settled(measured, world, plausible, plan)
    if not world.kept.any():
        return _failed(tracks, "too few tracks of every image are consistent with the factorisation")
    return _result(tracks, measured, world, plausible, order)


def _result(
    tracks: ImageTracks, measured: Measurements, world: World, plausible: BoolArray, order: NDArray[np.int64]
) -> ProjectiveReconstruction:
    problem, images, kept_tracks, rows = problem_of(measured, world)
    problem.metadata = Metadata(
        image_names=[tracks.names[image] for image in images.tolist()], image_sizes=tracks.sizes[images]
    )
    seen = np.bincount(measured.image, minlength=tracks.num_images)
    good = np.bincount(measured.image[plausible], minlength=tracks.num_images)
    missing = sorted(set(range(tracks.num_images)) - set(images.tolist()))
    left_out = {image: _reason(int(seen[image]), int(good[image])) for image in missing}
    return ProjectiveReconstruction(problem, images, kept_tracks, order[rows], world.sigma_px, left_out)


def _reason(seen: int, plausible: int) -> str:
    if not plausible:
        return f"none of its {seen} tracks is consistent with another image"
    return f"too few of its {plausible} plausible tracks are consistent with the cameras of the other images"


def _failed(tracks: ImageTracks, message: str) -> ProjectiveReconstruction:
    none = np.empty(0, dtype=np.int64)
    left_out = dict.fromkeys(range(tracks.num_images), message)
    return ProjectiveReconstruction(None, none, none, none, float("nan"), left_out, message)
