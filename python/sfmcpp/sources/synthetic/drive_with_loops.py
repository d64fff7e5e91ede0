"""A long drive that now and then comes back to where it was: a chain with a few long-range links."""

from __future__ import annotations

from itertools import accumulate
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sfmcpp.model import Problem
from sfmcpp.model.arguments import checked
from sfmcpp.sources.synthetic.image_geometry import NO_DISTORTION, Distortion
from sfmcpp.sources.synthetic.street_drive import street_drive

# How many blocks the way goes straight before a detour, and how far aside the detour leads: repeated.
_STRAIGHT_BLOCKS = (2, 6, 3, 8, 5, 10, 4)
_ASIDE_BLOCKS = (2, 1, 4, 3, 2)
# After a round trip so many blocks are driven again at least.
_BLOCKS_AGAIN = 2

_Block = NDArray[np.int64]
_EAST, _NORTH, _WEST, _SOUTH = np.array([1, 0]), np.array([0, 1]), np.array([-1, 0]), np.array([0, -1])


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
        _crossings,
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


def _crossings(blocks: float) -> list[tuple[int, int]]:
    """The longest round trip of so many blocks, and the first of its second lap where it is shorter."""
    longest = blocks - _BLOCKS_AGAIN
    legs = [_leg(0)]
    while len(_lap([*legs, _leg(len(legs))])) <= longest:
        legs.append(_leg(len(legs)))
    *before, last = legs
    while len(_lap([*before, _Leg(last.straight + 1, last.aside)])) <= longest:
        last = _Leg(last.straight + 1, last.aside)
    legs = [*before, last]
    lap = _lap(legs)
    steps = [lap[block % len(lap)] for block in range(int(np.ceil(blocks)) + 1)]
    return [(int(x), int(y)) for x, y in accumulate(steps, initial=np.zeros(2, dtype=int))]


def _leg(number: int) -> _Leg:
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
