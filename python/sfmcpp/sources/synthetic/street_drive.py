"""A vehicle that looks ahead on its way along streets, with tracks of the lengths that BAL's have."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sfmcpp.model import Problem
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_above, require_count, require_positive
from sfmcpp.sources.synthetic.image_geometry import Distortion, ImageGeometry
from sfmcpp.sources.synthetic.observation import keep_points_seen_twice, observe
from sfmcpp.sources.synthetic.sight import Sight
from sfmcpp.sources.synthetic.streets import LOOK_AHEAD_M, Route, StreetGrid

_POINTS_PER_CAMERA = 100
# Of the tracks of BAL's problem-49-7776 a share of about (2/k)^1.45 is of k or more observations. To begin
# below two, and to drop what is then seen once, gives the shortest tracks their share.
_TRACK_EXPONENT = 1.45
SHORTEST_TRACK = 1.5

# From a number of blocks to crossings along a way at least so long.
Crossings = Callable[[float], list[tuple[int, int]]]


def street_drive(
    crossings: Crossings,
    num_cameras: int,
    num_points: int | None,
    *,
    spacing_m: float,
    block_m: float,
    street_m: float,
    max_depth_m: float,
    focal_px: float,
    image_size: tuple[int, int],
    pixel_sigma_px: float,
    camera_model: str,
    distortion: Distortion,
    seed: int,
) -> Problem:
    """Drive along `crossings`; arguments and errors are those of :func:`city_blocks_scene`."""
    num_points = _POINTS_PER_CAMERA * num_cameras if num_points is None else num_points
    require_count("num_cameras", num_cameras, at_least=2)
    require_count("num_points", num_points)
    require_positive("spacing_m", spacing_m)
    require_positive("street_m", street_m)
    require_above("block_m", block_m, street_m, "the width of the street")
    geometry = ImageGeometry(camera_model, focal_px, image_size, distortion)
    nearest_m = street_m * focal_px / image_size[0]
    recognised_m = nearest_m + SHORTEST_TRACK * spacing_m
    require_above("max_depth_m", max_depth_m, recognised_m, "where a front comes into view and is recognised")
    rng = np.random.default_rng(seed)
    driven_m = spacing_m * np.arange(num_cameras, dtype=np.float64)
    fronts_m = rng.uniform(0, driven_m[-1] + recognised_m, num_points)
    longest_track = (max_depth_m - nearest_m) / spacing_m
    depth_m = nearest_m + spacing_m * track_lengths(num_points, longest_track, rng)
    grid = StreetGrid((block_m, block_m), street_m)
    route = Route(grid, crossings((driven_m[-1] + recognised_m + LOOK_AHEAD_M) / block_m))
    points = route.fronts(fronts_m, rng)
    sight = Sight(depth_m, grid.hides)
    return keep_points_seen_twice(
        observe(geometry, route.drive(driven_m), points, pixel_sigma_px, rng, sight)
    )


def track_lengths(count: int, longest: float, rng: np.random.Generator) -> FloatArray:
    """(count,) Pareto-distributed from the shortest to the `longest`, by the inverse of its distribution."""
    share_beyond = (SHORTEST_TRACK / longest) ** _TRACK_EXPONENT
    lengths: FloatArray = SHORTEST_TRACK * rng.uniform(share_beyond, 1, count) ** (-1 / _TRACK_EXPONENT)
    return lengths
