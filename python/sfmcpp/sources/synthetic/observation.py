"""Simulated observations: cameras that look at points."""

from __future__ import annotations

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_not_negative
from sfmcpp.sources.synthetic.image_geometry import ImageGeometry
from sfmcpp.sources.synthetic.sight import Lookout, Sight


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
    point_index = np.concatenate([indices for indices, _ in seen])
    camera_index = np.repeat(np.arange(len(cameras), dtype=np.int32), [len(i) for i, _ in seen])
    pixels = np.concatenate([exact for _, exact in seen])
    by_point = np.argsort(point_index, kind="stable")
    problem = Problem(
        geometry.camera_model,
        cameras,
        geometry.intrinsics(len(cameras)),
        points,
        camera_index[by_point],
        point_index[by_point],
        pixels[by_point] + pixel_sigma_px * rng.standard_normal(pixels.shape),
    )
    problem.metadata.image_sizes = np.tile(np.array(geometry.image_size, dtype=np.int64), (len(cameras), 1))
    return problem


def keep_points_seen_twice(problem: Problem) -> Problem:
    """Make the problem without the points that fewer than two cameras see, the others numbered anew.

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
    new_index = np.cumsum(kept, dtype=np.int32) - 1
    observed = kept[problem.point_index]
    return Problem(
        problem.camera_model,
        problem.cameras,
        problem.intrinsics,
        problem.points[kept],
        problem.camera_index[observed],
        new_index[problem.point_index[observed]],
        problem.pixels[observed],
        metadata=problem.metadata,
    )
