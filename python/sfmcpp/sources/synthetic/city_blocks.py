"""A vehicle that drives through a city, for as many cameras as wanted."""

from __future__ import annotations

from itertools import count

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_above, require_count, require_positive
from sfmcpp.sources.synthetic.image_geometry import NO_DISTORTION, Distortion, ImageGeometry
from sfmcpp.sources.synthetic.observation import keep_points_seen_twice, observe
from sfmcpp.sources.synthetic.sight import Sight
from sfmcpp.sources.synthetic.streets import LOOK_AHEAD_M, Route, StreetGrid

_POINTS_PER_CAMERA = 100
# Of the tracks of BAL's problem-49-7776 a share of about (2/k)^1.45 is of k or more observations. To begin
# below two, and to drop what is then seen once, gives the shortest tracks their share.
_TRACK_EXPONENT = 1.45
_SHORTEST_TRACK = 1.5


def city_blocks_scene(
    num_cameras: int = 1000,
    num_points: int | None = None,
    *,
    spacing_m: float = 3.0,
    block_m: float = 100.0,
    street_m: float = 14.0,
    max_depth_m: float = 100.0,
    focal_px: float = 500.0,
    image_size: tuple[int, int] = (1024, 768),
    pixel_sigma_px: float = 1.0,
    camera_model: str = "bal",
    distortion: Distortion = NO_DISTORTION,
    seed: int = 0,
) -> Problem:
    """A vehicle that drives all streets of a square city: problems of any size with tracks like BAL's.

    It drives row by row, then column by column, looking ahead, until it has taken its images; the more
    images, the larger the city. It meets its own way at every crossing. Points are house fronts along
    the way. Each is recognised only up to a depth of its own, drawn from a truncated Pareto distribution such
    that the numbers of observations a point are distributed as in BAL's Ladybug: most tracks are of two or
    three, a few of dozens. Houses hide what is behind them. Time and memory grow linearly with the cameras.

    Parameters
    ----------
    num_cameras : int
        Images taken; at least two.
    num_points : int, optional
        Points placed on the fronts; those that fewer than two cameras see are dropped. Default: 100 per
        camera.
    spacing_m : float
        From one image to the next [m].
    block_m : float
        From one street's axis to the next [m].
    street_m : float
        Width of the streets [m]; less than `block_m`.
    max_depth_m : float
        Depth beyond which no point is recognised [m]; it bounds the longest tracks.
    focal_px, image_size, pixel_sigma_px, camera_model, distortion, seed
        As for :func:`circle_scene`.

    Returns
    -------
    Problem
        Its cameras and points are the truth; see :func:`perturb` for a start away from it. Every camera
        stays; one of narrow view may see nothing while it turns at a corner.

    Raises
    ------
    InvalidArgument
        If a count is too low or no point is seen twice, a length is not positive, a street wider than a
        block, `max_depth_m` too small for any front to come into view, the camera model unknown, or if the
        distortion does not fit it.
    """
    num_points = _POINTS_PER_CAMERA * num_cameras if num_points is None else num_points
    require_count("num_cameras", num_cameras, at_least=2)
    require_count("num_points", num_points)
    require_positive("spacing_m", spacing_m)
    require_positive("street_m", street_m)
    require_above("block_m", block_m, street_m, "the width of the street")
    geometry = ImageGeometry(camera_model, focal_px, image_size, distortion)
    nearest_m = street_m * focal_px / image_size[0]
    recognised_m = nearest_m + _SHORTEST_TRACK * spacing_m
    require_above("max_depth_m", max_depth_m, recognised_m, "where a front comes into view and is recognised")
    rng = np.random.default_rng(seed)
    driven_m = spacing_m * np.arange(num_cameras, dtype=np.float64)
    fronts_m = rng.uniform(0, driven_m[-1] + recognised_m, num_points)
    longest_track = (max_depth_m - nearest_m) / spacing_m
    depth_m = nearest_m + spacing_m * _track_lengths(num_points, longest_track, rng)
    grid = StreetGrid((block_m, block_m), street_m)
    route = Route(grid, _crossings((driven_m[-1] + recognised_m + LOOK_AHEAD_M) / block_m))
    points = route.fronts(fronts_m, rng)
    sight = Sight(depth_m, grid.hides)
    return keep_points_seen_twice(
        observe(geometry, route.drive(driven_m), points, pixel_sigma_px, rng, sight)
    )


def _track_lengths(count: int, longest: float, rng: np.random.Generator) -> FloatArray:
    """(count,) Pareto-distributed from the shortest to the `longest`, by the inverse of its distribution."""
    share_beyond = (_SHORTEST_TRACK / longest) ** _TRACK_EXPONENT
    lengths: FloatArray = _SHORTEST_TRACK * rng.uniform(share_beyond, 1, count) ** (-1 / _TRACK_EXPONENT)
    return lengths


def _crossings(blocks: float) -> list[tuple[int, int]]:
    """The way through the smallest square city in which it is at least so many blocks long."""
    size = next(size for size in count(1) if 2 * size * (size + 2) >= blocks)
    rows = [(x if y % 2 == 0 else size - x, y) for y in range(size + 1) for x in range(size + 1)]
    end, _ = rows[-1]
    columns = [(slow if end == 0 else size - slow, size - fast) for fast, slow in rows]
    return rows + columns[1:]
