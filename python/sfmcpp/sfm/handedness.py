"""Whether the axes of positions are those of the world: if two are swapped, models hang in it upside down.

Swapped axes mirror the positions. Those of a flight lie near a plane, which a half turn about an axis in it
mirrors as well: they then fit, but the ground is above the cameras.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import agreeing_pairs, fit_similarity
from sfmcpp.model.arrays import FloatArray

# Of fewer pairs, honest ones of 1 m in a flat scene fit a mirrored model as well by chance.
_LEAST_PAIRS = 8
_MUCH_BETTER = 0.5
# Mean height of a direction of unit length over all cameras: of what is up in images, and of where they look.
_HEADS_DOWN, _TO_THE_SKY = -0.3, 0.8
_MIRROR = np.array([1.0, 1.0, -1.0])


def swapped_axes(poses: FloatArray, centres: FloatArray, metres: FloatArray, *, seed: int) -> str:
    """Say what speaks for axes of the positions that are swapped.

    Parameters
    ----------
    poses : (C, 3, 4) float64
        Cameras ``[R | c]`` world_from_camera in the world of the positions.
    centres, metres : (n, 3) float64
        Centres of those with positions, and these.
    seed : int
        Of the search for those that agree.

    Returns
    -------
    str
        Half a sentence; empty if nothing does.
    """
    if len(centres) >= _LEAST_PAIRS:
        as_they_are, mirrored = (_median_distance(c, metres, seed) for c in (centres, centres * _MIRROR))
        if mirrored < _MUCH_BETTER * as_they_are:
            return f"mirrored, they fit the images to {mirrored:.2g} m instead of {as_they_are:.2g} m"
    up, ahead = -poses[:, 2, 1].mean(), poses[:, 2, 2].mean()
    if up < _HEADS_DOWN:
        return "the cameras are upside down"
    return "the cameras look at the sky" if ahead > _TO_THE_SKY else ""


def _median_distance(centres: FloatArray, metres: FloatArray, seed: int) -> float:
    good = agreeing_pairs(centres, metres, seed=seed)
    try:
        placed = fit_similarity(centres[good], metres[good])
    except InvalidArgument:  # on a line: there is no other hand
        return np.inf
    return float(np.median(np.linalg.norm(placed.apply(centres) - metres, axis=1)))
