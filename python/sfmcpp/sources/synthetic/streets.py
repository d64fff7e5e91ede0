"""A city of equal blocks: routes along its streets, house fronts beside them, and what the houses hide."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.checks import require_above, require_count, require_positive
from sfmcpp.sources.synthetic.image_geometry import UP, Distortion, ImageGeometry, looking_at
from sfmcpp.sources.synthetic.observation import keep_points_seen_twice, observe
from sfmcpp.sources.synthetic.sight import Sight, enters

CAMERA_HEIGHT_M = 2.0
LOOK_AHEAD_M = 12.0
FRONT_HEIGHT_M = 7.5
# Balconies and bay windows: how far fronts stand out, so that no street is made of two planes.
_RELIEF_M = 0.5
_POINTS_PER_CAMERA = 100
# Of the tracks of BAL's problem-49-7776 a share of about (2/k)^1.45 is of k or more observations. To begin
# below two, and to drop what is then seen once, gives the shortest tracks their share.
_TRACK_EXPONENT = 1.45
SHORTEST_TRACK = 1.5
# From a number of blocks to crossings along a way at least so long.
Crossings = Callable[[float], list[tuple[int, int]]]


@dataclass(frozen=True)
class StreetGrid:
    """A city without end: streets of one width around blocks of one size, all of it house.

    The axes of the streets are the lines where x or y is a multiple of `pitch_m`.

    Attributes
    ----------
    pitch_m : (float, float)
        From one street's axis to the next, along x and along y [m].
    street_m : float
        Width of the streets [m]; less than either pitch.
    """

    pitch_m: tuple[float, float]
    street_m: float

    def hides(self, centre: FloatArray, points: FloatArray) -> BoolArray:
        """(N,) whether a house stands between `centre` (3,) and each of `points` (N, 3)."""
        pitch = np.array(self.pitch_m)
        start, way = centre[:2], points[:, :2] - centre[:2]
        first = np.floor(np.minimum(start, points[:, :2]) / pitch)
        last = np.floor(np.maximum(start, points[:, :2]) / pitch)
        hidden = np.zeros(len(points), dtype=np.bool_)
        most_right, most_up = (last - first).max(axis=0, initial=0).astype(int)
        for block in product(range(most_right + 1), range(most_up + 1)):
            corner = (first + block) * pitch + self.street_m / 2
            hidden |= enters(start, way, corner, corner + pitch - self.street_m)
        return hidden

    def reliefs_m(self, count: int, rng: np.random.Generator) -> FloatArray:
        """(count,) how far points of fronts stand out into the street [m]."""
        return rng.uniform(0, min(_RELIEF_M, self.street_m / 4), count)


class Route:
    """A way along the axes of streets, from crossing to crossing.

    Parameters
    ----------
    grid : StreetGrid
        The city.
    crossings : (K, 2) int
        Each next to the one before it, counted in streets along x and y.
    """

    def __init__(self, grid: StreetGrid, crossings: ArrayLike) -> None:
        self._grid = grid
        self._corners = np.asarray(crossings) * np.array(grid.pitch_m)
        steps = np.diff(self._corners, axis=0)
        self._lengths_m = np.linalg.norm(steps, axis=1)
        self._directions = steps / self._lengths_m[:, None]
        self._driven_m = np.concatenate([[0.0], np.cumsum(self._lengths_m)])

    def at(self, driven_m: FloatArray) -> FloatArray:
        """(N, 2) place after so many metres (N,)."""
        return np.stack([np.interp(driven_m, self._driven_m, axis) for axis in self._corners.T], axis=1)

    def drive(self, driven_m: FloatArray, yaw_deg: float = 0.0) -> FloatArray:
        """(N, 3, 4) cameras of a vehicle after so many metres (N,), level.

        They look at the place where the vehicle will be a little later, so they turn before the corners, or
        `yaw_deg` to the left of that.
        """
        places = self.at(driven_m)
        ahead = (self.at(driven_m + LOOK_AHEAD_M) - places) @ _turned_left(yaw_deg).T
        centres = np.column_stack([places, np.full(len(places), CAMERA_HEIGHT_M)])
        return looking_at(centres, centres + np.column_stack([ahead, np.zeros(len(places))]), UP)

    def fronts(self, driven_m: FloatArray, rng: np.random.Generator) -> FloatArray:
        """(N, 3) points on the house fronts left and right of the places after so many metres (N,).

        Crossings have no fronts: each stretch between two of them is compressed to the block beside it.
        """
        count = len(driven_m)
        stretch = np.searchsorted(self._driven_m[1:-1], driven_m, side="right")
        length_m, forward = self._lengths_m[stretch], self._directions[stretch]
        share = (driven_m - self._driven_m[stretch]) / length_m
        street_m = self._grid.street_m
        along_m = street_m / 2 + share * (length_m - street_m)
        aside_m = rng.choice([-1.0, 1.0], count) * (street_m / 2 - self._grid.reliefs_m(count, rng))
        left = forward @ _turned_left(90.0).T
        place = self._corners[stretch] + along_m[:, None] * forward + aside_m[:, None] * left
        return np.column_stack([place, rng.uniform(0, FRONT_HEIGHT_M, count)])


def _turned_left(angle_deg: float) -> FloatArray:
    angle = np.deg2rad(angle_deg)
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


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
