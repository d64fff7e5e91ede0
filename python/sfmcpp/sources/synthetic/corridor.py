"""A camera that walks down a corridor."""

from __future__ import annotations

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_count, require_positive
from sfmcpp.sources.synthetic.image_geometry import NO_DISTORTION, UP, Distortion, ImageGeometry, looking_at
from sfmcpp.sources.synthetic.observation import keep_points_seen_twice, observe
from sfmcpp.sources.synthetic.sight import Sight

FORWARD = np.array([1.0, 0.0, 0.0])
"""World direction in which the corridor runs."""
_EYE_HEIGHT_SHARE = 0.6


@checked()
def corridor_scene(
    num_cameras: int = 60,
    num_points: int = 4000,
    *,
    length_m: float = 60.0,
    width_m: float = 3.0,
    height_m: float = 2.5,
    max_depth_m: float = 8.0,
    focal_px: float = 500.0,
    image_size: tuple[int, int] = (640, 480),
    pixel_sigma_px: float = 1.0,
    camera_model: str = "calibrated",
    distortion: Distortion = NO_DISTORTION,
    seed: int = 0,
) -> Problem:
    """A camera carried along a corridor, looking forward: a long chain of short tracks without a loop.

    The walk goes along x from the origin of the floor, y is left and z up. Points lie on both walls, the
    floor and the ceiling, which reach `max_depth_m` beyond the end of the walk.

    Parameters
    ----------
    num_cameras : int
        Images taken, evenly spaced; at least two.
    num_points : int
        Points placed; those that fewer than two cameras see are dropped.
    length_m : float
        Way from the first camera to the last [m].
    width_m, height_m : float
        Cross-section of the corridor [m]; the camera walks in the middle, at 0.6 of the height.
    max_depth_m : float
        Depth beyond which a camera sees nothing [m]; it bounds the length of the tracks.
    focal_px, image_size, pixel_sigma_px, camera_model, distortion, seed
        As for :func:`circle_scene`.

    Returns
    -------
    Problem
        Its cameras and points are the truth; see :func:`perturb` for a start away from it.

    Raises
    ------
    InvalidArgument
        If a count is too low or no point is seen twice, a length is not positive, the camera model is
        unknown or the distortion does not fit it.
    """
    require_count("num_cameras", num_cameras, at_least=2)
    require_count("num_points", num_points)
    lengths = {"length_m": length_m, "width_m": width_m, "height_m": height_m, "max_depth_m": max_depth_m}
    for name, value in lengths.items():
        require_positive(name, value)
    geometry = ImageGeometry(camera_model, focal_px, image_size, distortion)
    rng = np.random.default_rng(seed)
    centres = walk(num_cameras, length_m, height_m)
    cameras = looking_at(centres, centres + FORWARD, UP)
    points = corridor_points(num_points, length_m + max_depth_m, width_m, height_m, rng)
    return keep_points_seen_twice(observe(geometry, cameras, points, pixel_sigma_px, rng, Sight(max_depth_m)))


def walk(count: int, length_m: float, height_m: float) -> FloatArray:
    """(count, 3) places along the middle of a corridor of that height, evenly spaced."""
    along_m = np.linspace(0, length_m, count)
    return np.stack([along_m, np.zeros(count), np.full(count, _EYE_HEIGHT_SHARE * height_m)], axis=1)


def corridor_points(
    count: int, length_m: float, width_m: float, height_m: float, rng: np.random.Generator
) -> FloatArray:
    """(count, 3) points, uniform on walls, floor and ceiling."""
    along_m = rng.uniform(0, length_m, count)
    return np.column_stack([along_m, _on_section(count, width_m, height_m, rng)])


def _on_section(count: int, width_m: float, height_m: float, rng: np.random.Generator) -> FloatArray:
    """(count, 2) left and up: uniform on the outline of the cross-section."""
    outline = np.array([[-1, 0], [1, 0], [1, 1], [-1, 1], [-1, 0]]) * [width_m / 2, height_m]
    corners_m = np.cumsum([0.0, width_m, height_m, width_m, height_m])
    around_m = rng.uniform(0, corners_m[-1], count)
    return np.stack([np.interp(around_m, corners_m, side) for side in outline.T], axis=1)
