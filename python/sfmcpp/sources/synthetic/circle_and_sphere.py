"""Cameras around points: on the circle of the thesis' convergence experiments, and on a sphere."""

from __future__ import annotations

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_count, require_positive
from sfmcpp.sources.synthetic.image_geometry import NO_DISTORTION, UP, Distortion, ImageGeometry, looking_at
from sfmcpp.sources.synthetic.observation import observe

_GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))


@checked()
def circle_scene(
    num_cameras: int = 30,
    num_points: int = 500,
    *,
    radius_m: float = 20.0,
    cube_m: float = 6.0,
    focal_px: float = 1000.0,
    image_size: tuple[int, int] = (640, 480),
    pixel_sigma_px: float = 1.0,
    camera_model: str = "calibrated",
    distortion: Distortion = NO_DISTORTION,
    seed: int = 0,
) -> Problem:
    """Cameras evenly spaced on a circle around a cube of random points (thesis §4.4.1.2).

    The world has its origin at the centre of the cube, the cameras in the plane z = 0 and z up. The thesis
    also drops images with fewer than ten points; here every camera is kept.

    Parameters
    ----------
    num_cameras, num_points : int
        How many of each.
    radius_m : float
        Radius of the circle [m].
    cube_m : float
        Edge of the cube in which the points are uniform [m].
    focal_px : float
        Focal length of every camera [px].
    image_size : (int, int)
        Width and height [px]; points that project outside are not observed.
    pixel_sigma_px : float
        Standard deviation of the Gaussian noise on each pixel coordinate [px].
    camera_model : str
        ``"calibrated"`` or ``"perspective"`` (principal point at the image centre), or ``"bal"`` (pixels
        counted from the image centre). Each camera has its own row of intrinsics.
    distortion : (float, float)
        Radial distortion k1, k2, invertible within the image; ``"calibrated"`` has none.
    seed : int
        Same seed, same problem; the points do not depend on the noise.

    Returns
    -------
    Problem
        Its cameras and points are the truth; see :func:`perturb` for a start away from it.

    Raises
    ------
    InvalidArgument
        If a count is below one, a length is not positive, the camera model is unknown or the distortion
        does not fit it.
    """
    require_count("num_cameras", num_cameras)
    require_count("num_points", num_points)
    require_positive("radius_m", radius_m)
    require_positive("cube_m", cube_m)
    geometry = ImageGeometry(camera_model, focal_px, image_size, distortion)
    rng = np.random.default_rng(seed)
    points = rng.uniform(-cube_m / 2, cube_m / 2, (num_points, 3))
    return observe(geometry, _circle(num_cameras, radius_m), points, pixel_sigma_px, rng)


def _circle(num_cameras: int, radius_m: float) -> FloatArray:
    angle = np.arange(num_cameras) * (2 * np.pi / num_cameras)
    centres = radius_m * np.stack([np.cos(angle), np.sin(angle), np.zeros(num_cameras)], axis=1)
    return looking_at(centres, np.zeros(3), UP)


@checked()
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
    focal_px, image_size, pixel_sigma_px, camera_model, distortion, seed
        As for :func:`circle_scene`.

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
    return observe(geometry, cameras, _uniform_in_ball(num_points, ball_m, rng), pixel_sigma_px, rng)


def _fibonacci_lattice(count: int) -> FloatArray:
    """(count, 3) unit vectors."""
    z = 1 - (2 * np.arange(count) + 1) / count
    angle = np.arange(count) * _GOLDEN_ANGLE
    ring = np.sqrt(1 - z**2)
    return np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)


def _uniform_in_ball(count: int, radius_m: float, rng: np.random.Generator) -> FloatArray:
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    points: FloatArray = radius_m * np.cbrt(rng.uniform(size=(count, 1))) * directions
    return points
