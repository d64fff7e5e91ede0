"""A vehicle that drives once around a block."""

from __future__ import annotations

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_above, require_count, require_finite, require_positive
from sfmcpp.sources.synthetic.image_geometry import NO_DISTORTION, Distortion, ImageGeometry
from sfmcpp.sources.synthetic.observation import keep_points_seen_twice, observe
from sfmcpp.sources.synthetic.sight import Sight
from sfmcpp.sources.synthetic.streets import FRONT_HEIGHT_M, Route, StreetGrid

# One lap, and a part of the next to look ahead to.
_CROSSINGS = ((0, 0), (1, 0), (1, 1), (0, 1), (0, 0), (1, 0))


@checked()
def street_loop_scene(
    num_cameras: int = 160,
    num_points: int = 8000,
    *,
    length_m: float = 100.0,
    width_m: float = 60.0,
    street_m: float = 14.0,
    max_depth_m: float = 40.0,
    yaw_deg: float = 0.0,
    focal_px: float = 500.0,
    image_size: tuple[int, int] = (1024, 768),
    pixel_sigma_px: float = 1.0,
    camera_model: str = "calibrated",
    distortion: Distortion = NO_DISTORTION,
    seed: int = 0,
) -> Problem:
    """A vehicle that drives once around a block between house fronts, and closes the loop.

    It starts in the middle of the first street, drives along x and turns left at every corner; z is up.
    The last camera stands one spacing behind the first and sees what the first ones saw. The outer fronts
    have no gaps; the houses of the block occlude what is behind them.

    Parameters
    ----------
    num_cameras : int
        Images taken, evenly spaced; at least two.
    num_points : int
        Points placed on the fronts on both sides; those that fewer than two cameras see are dropped.
    length_m, width_m : float
        Sides of the loop, measured in the middle of the streets [m].
    street_m : float
        Width of the streets [m]; less than both sides.
    max_depth_m : float
        Depth beyond which a camera sees nothing [m].
    yaw_deg : float
        From the driving direction to the optical axis, to the left [deg]: 0 looks ahead, 90 at the block.
    focal_px, image_size, pixel_sigma_px, camera_model, distortion, seed
        As for :func:`circle_scene`.

    Returns
    -------
    Problem
        Its cameras and points are the truth; see :func:`perturb` for a start away from it.

    Raises
    ------
    InvalidArgument
        If a count is too low or no point is seen twice, a length is not positive or a street wider than the
        loop, the camera model is unknown or the distortion does not fit it.
    """
    require_count("num_cameras", num_cameras, at_least=2)
    require_count("num_points", num_points)
    require_positive("street_m", street_m)
    require_above("length_m", length_m, street_m, "the width of the street")
    require_above("width_m", width_m, street_m, "the width of the street")
    require_positive("max_depth_m", max_depth_m)
    require_finite("yaw_deg", yaw_deg)
    geometry = ImageGeometry(camera_model, focal_px, image_size, distortion)
    rng = np.random.default_rng(seed)
    grid = StreetGrid((length_m, width_m), street_m)
    route, lap_m = Route(grid, _CROSSINGS), 2 * (length_m + width_m)
    cameras = route.drive(length_m / 2 + np.linspace(0, lap_m, num_cameras, endpoint=False), yaw_deg)
    points = _fronts(num_points, grid, rng)
    sight = Sight(max_depth_m, grid.hides)
    return keep_points_seen_twice(observe(geometry, cameras, points, pixel_sigma_px, rng, sight))


def _fronts(count: int, grid: StreetGrid, rng: np.random.Generator) -> FloatArray:
    """(count, 3) points around the block and, as many, on the outer side of the streets around it."""
    sides_m = np.array(grid.pitch_m)
    outer = rng.choice([-1.0, 1.0], count)
    halves_m = (sides_m + (outer * (grid.street_m - 2 * grid.reliefs_m(count, rng)))[:, None]) / 2
    along, end = rng.uniform(-1, 1, count), rng.choice([-1.0, 1.0], count)
    on_length = rng.uniform(size=count) < sides_m[0] / sides_m.sum()
    on_square = np.where(on_length, [along, end], [end, along]).T
    return np.column_stack([sides_m / 2 + on_square * halves_m, rng.uniform(0, FRONT_HEIGHT_M, count)])
