"""Simulated observations: cameras that look at points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray, IndexArray
from sfmcpp.model.checks import require_not_negative
from sfmcpp.sources.synthetic.image_geometry import ImageGeometry
from sfmcpp.sources.synthetic.sight import Lookout, Sight

_NOISE_BLOCK = 1 << 20


def observe(
    geometry: ImageGeometry,
    cameras: FloatArray,
    points: FloatArray,
    pixel_sigma_px: float,
    rng: np.random.Generator,
    sight: Sight | None = None,
) -> Problem:
    """Make the problem of `cameras` (C, 3, 4) that look at `points` (N, 3), its state the truth.

    A camera observes the points in front of it whose exact projection lies in the image and that `sight`,
    if given, lets it see; Gaussian noise of `pixel_sigma_px` is then added to each coordinate. Observations
    are sorted by point, then by camera. Without `sight` every camera looks at every point; with it, time and
    memory grow with the number of observations.

    Raises
    ------
    InvalidArgument
        If `pixel_sigma_px` is negative or not finite.
    """
    require_not_negative("pixel_sigma_px", pixel_sigma_px)
    if sight is None:
        seen = [geometry.project(camera, points) for camera in cameras]
    else:
        lookout = Lookout(geometry, points, sight)
        seen = [lookout.view(camera) for camera in cameras]
    camera_index = np.repeat(np.arange(len(cameras), dtype=np.int32), [len(i) for i, _ in seen])
    point_index = np.concatenate([indices for indices, _ in seen])
    pixels = np.concatenate([exact for _, exact in seen])
    del seen
    views = Views(camera_index, point_index, pixels)
    return problem_of_views(geometry, cameras, points, views, pixel_sigma_px, rng)


@dataclass(frozen=True, eq=False)
class Views:
    """Observations of points without noise: M camera and point indices, (M, 2) pixels."""

    camera_index: IndexArray
    point_index: IndexArray
    pixels: FloatArray

    @staticmethod
    def joined(parts: Sequence[Views]) -> Views:
        """The views of all parts, in order."""
        columns = zip(*((part.camera_index, part.point_index, part.pixels) for part in parts), strict=True)
        return Views(*map(np.concatenate, columns))


def problem_of_views(
    geometry: ImageGeometry,
    cameras: FloatArray,
    points: FloatArray,
    views: Views,
    pixel_sigma_px: float,
    rng: np.random.Generator,
) -> Problem:
    """Sort the views by point and then by camera, and add Gaussian noise to each coordinate.

    Raises
    ------
    InvalidArgument
        If `pixel_sigma_px` is negative or not finite.
    """
    require_not_negative("pixel_sigma_px", pixel_sigma_px)
    by_point = np.lexsort((views.camera_index, views.point_index))
    pixels = views.pixels[by_point]
    add_noise(pixels, pixel_sigma_px, rng)
    problem = Problem(
        geometry.camera_model,
        cameras,
        geometry.intrinsics(len(cameras)),
        points,
        views.camera_index[by_point],
        views.point_index[by_point],
        pixels,
    )
    problem.metadata.image_sizes = np.tile(np.array(geometry.image_size, dtype=np.int64), (len(cameras), 1))
    return problem


def add_noise(pixels: FloatArray, sigma_px: float, rng: np.random.Generator) -> None:
    """Add Gaussian noise to `pixels` (M, 2) in place: by blocks, with the numbers of one call."""
    for start in range(0, len(pixels), _NOISE_BLOCK):
        block = pixels[start : start + _NOISE_BLOCK]
        block += sigma_px * rng.standard_normal(block.shape)


def keep_points_seen_twice(problem: Problem) -> Problem:
    """Make the problem without the points that fewer than two cameras see, the others numbered anew.

    All else is kept: intrinsics that cameras share, masks, uncertainties, rigs and metadata.

    Raises
    ------
    InvalidArgument
        If no point is left.
    """
    kept = np.bincount(problem.point_index, minlength=problem.num_points) >= 2
    if not kept.any():
        raise InvalidArgument(
            f"num_cameras = {problem.num_cameras}: no point is seen by two of them; "
            "they are too far apart, or the points too few"
        )
    return problem.with_points(np.flatnonzero(kept))
