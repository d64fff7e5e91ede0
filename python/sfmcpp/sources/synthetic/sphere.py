"""Cameras all around a ball of points."""

from __future__ import annotations

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_count, require_positive
from sfmcpp.sources.synthetic.distortion import NO_DISTORTION, Distortion
from sfmcpp.sources.synthetic.geometry import UP, looking_at
from sfmcpp.sources.synthetic.image_geometry import ImageGeometry
from sfmcpp.sources.synthetic.observation import observe

_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


def sphere_scene(
    num_cameras: int = 50,
    num_points: int = 500,
    *,
    radius_m: float = 20.0,
    ball_m: float = 4.0,
    focal_px: float = 1000.0,
    image_size: tuple[int, int] = (640, 480),
    pixel_sigma_px: float = 1.0,
    camera_model: str = "calibrated",
    distortion: Distortion = NO_DISTORTION,
    seed: int = 0,
) -> Problem:
    """Cameras spread evenly over a sphere around a ball of random points, looking at its centre.

    The cameras lie on a Fibonacci lattice: their heights are evenly spaced, each is turned by the golden
    angle against the one above (González, Measurement of areas on a sphere using Fibonacci and
    latitude–longitude lattices, 2010). No camera stands on a pole, where up would be undefined.

    Parameters
    ----------
    num_cameras, num_points : int
        How many of each.
    radius_m : float
        Radius of the sphere [m].
    ball_m : float
        Radius of the ball in which the points are uniform [m].
    focal_px : float
        Focal length of every camera [px].
    image_size : (int, int)
        Width and height [px]; points that project outside are not observed.
    pixel_sigma_px : float
        Standard deviation of the Gaussian noise on each pixel coordinate [px].
    camera_model : str
        ``"calibrated"``, ``"perspective"`` or ``"bal"``, as for :func:`circle_scene`.
    distortion : (float, float)
        Radial distortion k1, k2, invertible within the image; ``"calibrated"`` has none.
    seed : int
        Same seed, same problem; the points do not depend on the noise.

    Returns
    -------
    Problem
        Its cameras and points are the truth. Every camera and every point stays, seen or not.

    Raises
    ------
    InvalidArgument
        If a count is below one, a length is not positive, the camera model is unknown or the distortion
        does not fit it.
    """
    require_count("num_cameras", num_cameras)
    require_count("num_points", num_points)
    require_positive("radius_m", radius_m)
    require_positive("ball_m", ball_m)
    geometry = ImageGeometry(camera_model, focal_px, image_size, distortion)
    rng = np.random.default_rng(seed)
    cameras = looking_at(radius_m * _fibonacci_lattice(num_cameras), np.zeros(3), UP)
    return observe(geometry, cameras, _in_ball(num_points, ball_m, rng), pixel_sigma_px, rng)


def _fibonacci_lattice(count: int) -> FloatArray:
    """(count, 3) unit vectors."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.arange(count) * _GOLDEN_ANGLE
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def _in_ball(count: int, radius_m: float, rng: np.random.Generator) -> FloatArray:
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points: FloatArray = radius_m * np.cbrt(rng.uniform(size=(count, 1))) * directions
    return points
