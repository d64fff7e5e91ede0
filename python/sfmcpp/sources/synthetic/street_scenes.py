"""Scenes of a vehicle in the streets of a city: along all blocks, once around one, and a drive with loops."""

from __future__ import annotations

from itertools import accumulate, count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_above, require_count, require_finite, require_positive
from sfmcpp.sources.synthetic.image_geometry import NO_DISTORTION, Distortion, ImageGeometry
from sfmcpp.sources.synthetic.observation import keep_points_seen_twice, observe
from sfmcpp.sources.synthetic.sight import Sight
from sfmcpp.sources.synthetic.streets import FRONT_HEIGHT_M, Route, StreetGrid, street_drive

# One lap, and a part of the next to look ahead to.
_BLOCK_CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1), (0, 0), (1, 0))
# How many blocks the way goes straight before a detour, and how far aside the detour leads: repeated.
_STRAIGHT_BLOCKS = (2, 6, 3, 8, 5, 10, 4)
_ASIDE_BLOCKS = (2, 1, 4, 3, 2)
# After a round trip so many blocks are driven again at least.
_BLOCKS_AGAIN = 2
_Block = NDArray[np.int64]
_EAST, _NORTH, _WEST, _SOUTH = np.array([1, 0]), np.array([0, 1]), np.array([-1, 0]), np.array([0, -1])


@checked()
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
    """A vehicle that drives all streets of a square city: problems of any size with track lengths like BAL's.

    It drives row by row, then column by column, looking ahead, until it has taken its images; the city grows
    with the number of images. The path crosses itself at every crossing. Points are on the house fronts along
    the path. Each is visible up to its own depth, drawn from a truncated Pareto distribution such that the
    track lengths are distributed as in BAL's Ladybug: most are two or three, a few are dozens. Houses occlude
    what is behind them. Time and memory grow linearly with the cameras.

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
    return street_drive(
        _rows_and_columns,
        num_cameras,
        num_points,
        spacing_m=spacing_m,
        block_m=block_m,
        street_m=street_m,
        max_depth_m=max_depth_m,
        focal_px=focal_px,
        image_size=image_size,
        pixel_sigma_px=pixel_sigma_px,
        camera_model=camera_model,
        distortion=distortion,
        seed=seed,
    )


def _rows_and_columns(blocks: float) -> list[tuple[int, int]]:
    """The way through the smallest square city in which it is at least so many blocks long."""
    size = next(size for size in count(1) if 2 * size * (size + 2) >= blocks)
    rows = [(x if y % 2 == 0 else size - x, y) for y in range(size + 1) for x in range(size + 1)]
    end, _ = rows[-1]
    columns = [(slow if end == 0 else size - slow, size - fast) for fast, slow in rows]
    return rows + columns[1:]


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
    route, lap_m = Route(grid, _BLOCK_CORNERS), 2 * (length_m + width_m)
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


@checked()
def drive_with_loops_scene(
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
    """A vehicle on a long round trip with detours: a chain of cameras with loops of all lengths.

    The vehicle drives along a street and, after some blocks, goes around a few adjacent blocks. It returns to
    the street one block before the turn-off, drives that block again, and goes on. Halfway, it returns by the
    next street but one, with detours on the outer side, to its start: one large loop, and a second lap for
    the remaining images. Otherwise the scene is as :func:`city_blocks_scene`, whose path crosses itself at
    every crossing: here two thirds of the cameras of a long drive share points only with those shortly before
    and after them.

    Parameters
    ----------
    num_cameras : int
        Images taken; at least two. A way too short for the round trip ends where the images do.
    num_points, spacing_m, block_m, street_m, max_depth_m
        As for :func:`city_blocks_scene`.
    focal_px, image_size, pixel_sigma_px, camera_model, distortion, seed
        As for :func:`circle_scene`.

    Returns
    -------
    Problem
        Its cameras and points are the truth; see :func:`perturb` for a start away from it.

    Raises
    ------
    InvalidArgument
        As :func:`city_blocks_scene`.
    """
    return street_drive(
        _route_with_loops,
        num_cameras,
        num_points,
        spacing_m=spacing_m,
        block_m=block_m,
        street_m=street_m,
        max_depth_m=max_depth_m,
        focal_px=focal_px,
        image_size=image_size,
        pixel_sigma_px=pixel_sigma_px,
        camera_model=camera_model,
        distortion=distortion,
        seed=seed,
    )


class _Leg(NamedTuple):
    """Straight on for some blocks, then a detour so far aside."""

    straight: int
    aside: int


def _route_with_loops(blocks: float) -> list[tuple[int, int]]:
    """The longest round trip of so many blocks, and the first of its second lap where it is shorter."""
    longest = blocks - _BLOCKS_AGAIN
    legs = [_leg_of_number(0)]
    while len(_lap([*legs, _leg_of_number(len(legs))])) <= longest:
        legs.append(_leg_of_number(len(legs)))
    *before, last = legs
    while len(_lap([*before, _Leg(last.straight + 1, last.aside)])) <= longest:
        last = _Leg(last.straight + 1, last.aside)
    legs = [*before, last]
    lap = _lap(legs)
    steps = [lap[block % len(lap)] for block in range(int(np.ceil(blocks)) + 1)]
    return [(int(x), int(y)) for x, y in accumulate(steps, initial=np.zeros(2, dtype=int))]


def _leg_of_number(number: int) -> _Leg:
    return _Leg(_STRAIGHT_BLOCKS[number % len(_STRAIGHT_BLOCKS)], _ASIDE_BLOCKS[number % len(_ASIDE_BLOCKS)])


def _lap(legs: list[_Leg]) -> list[_Block]:
    """The blocks driven on a round trip: out to the east, two blocks aside, back to the west, and closed."""
    out = [step for leg in legs for step in _detour(leg, _EAST, _NORTH)]
    back = [step for leg in reversed(legs) for step in _detour(leg, _WEST, _SOUTH)]
    return [*out, _SOUTH, _SOUTH, *back, _NORTH, _NORTH]


def _detour(leg: _Leg, ahead: _Block, aside: _Block) -> list[_Block]:
    """Straight on, around a few blocks, and along the last straight block again."""
    around = [aside] * leg.aside + [-ahead] + [-aside] * leg.aside
    return [ahead] * leg.straight + around + [ahead]
