"""Checks of positions of images: redundancy, undecidable positions, swapped axes.

How far the others check a coordinate is its redundancy number (W. Förstner and B. Wrobel, "Photogrammetric
Computer Vision", 2016): the part of an error in it that is left in its residual once a similarity is
fitted to all. Where the others lie on a line it is zero for what a turn about that line moves.

Swapped axes mirror the positions. Those of a flight lie near a plane, which a half turn about an axis in it
mirrors as well: they then fit, but the ground is above the cameras.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import agreeing_pairs, fit_similarity
from sfmcpp.geometry.similarity import motions_of_positions
from sfmcpp.model.arrays import BoolArray, FloatArray

# Below it a coordinate counts as not checked; Förstner's usual bound.
_LEAST_REDUNDANCY = 0.1
# What no similarity explains of a position, in parts of its distance from the others, makes it a lie.
_UNEXPLAINED = 0.1
# Of fewer pairs, honest ones of 1 m in a flat scene fit a mirrored model as well by chance.
_LEAST_PAIRS = 8
_MUCH_BETTER = 0.5
_MOST = 0.9
# Mean height of a direction of unit length over all cameras: of what is up in images, and of where they look.
_HEADS_DOWN, _TO_THE_SKY = -0.3, 0.8
_MIRROR = np.array([1.0, 1.0, -1.0])


def unchecked_positions(centres: FloatArray, weights: FloatArray, trusted: BoolArray) -> BoolArray:
    """Find the positions of which some direction is not checked by those that are trusted.

    Parameters
    ----------
    centres : (n, 3) float64
        Centres of the cameras in the model.
    weights : (n, 3) float64
        Of the coordinates of their positions.
    trusted : (n,) bool
        Which positions the others are checked by.

    Returns
    -------
    (n,) bool
    """
    around = centres - centres[trusted].mean(axis=0)
    rows = np.sqrt(weights)[:, :, None] * motions_of_positions(around / np.linalg.norm(around, axis=1).max())
    normals = np.swapaxes(rows, 1, 2) @ rows
    together = normals[trusted].sum(axis=0) + np.where(trusted[:, None, None], 0.0, normals)
    hats = rows @ np.linalg.pinv(together, hermitian=True) @ np.swapaxes(rows, 1, 2)
    return np.asarray(np.linalg.eigvalsh(hats)[:, -1] > 1 - _LEAST_REDUNDANCY)


def undecidable_positions(
    centres: FloatArray, metres: FloatArray, weights: FloatArray, trusted: BoolArray
) -> BoolArray:
    """Find the positions that disagree, and that a turn which no other forbids would bring to agree.

    Parameters
    ----------
    centres, metres : (n, 3) float64
        Centres of the cameras in the model, and their positions.
    weights : (n, 3) float64
        Of the coordinates of the positions.
    trusted : (n,) bool
        Which positions agree.

    Returns
    -------
    (n,) bool
    """
    if not trusted.any():
        return trusted
    found = unchecked_positions(centres, weights, trusted) & ~trusted
    for image in np.flatnonzero(found):
        found[image] = _fits_after_move(centres, metres, trusted, image)
    return found


def _fits_after_move(centres: FloatArray, metres: FloatArray, trusted: BoolArray, image: np.intp) -> bool:
    chosen = trusted.copy()
    chosen[image] = True
    try:
        placed = fit_similarity(centres[chosen], metres[chosen])
    except InvalidArgument:
        return False
    left = np.linalg.norm(placed.apply(centres[image]) - metres[image])
    lever = np.linalg.norm(metres[image] - metres[trusted].mean(axis=0))
    return bool(left <= _UNEXPLAINED * lever)


def evidence_of_swapped_axes(poses: FloatArray, centres: FloatArray, metres: FloatArray, *, seed: int) -> str:
    """Evidence that axes of the positions are swapped.

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


def evidence_of_shifted_rows(centres: FloatArray, metres: FloatArray, *, seed: int) -> str:
    """Evidence that each position is that of the image before or after it.

    Parameters
    ----------
    centres, metres : (n, 3) float64
        Centres of the cameras in the order of their images, and their positions.
    seed : int
        Of the search for those that agree.

    Returns
    -------
    str
        Half a sentence; empty if nothing does.
    """
    if len(centres) <= _LEAST_PAIRS:
        return ""
    as_they_are = _most_distances(centres, metres, seed)
    shifted = {
        "after": _most_distances(centres[1:], metres[:-1], seed),
        "before": _most_distances(centres[:-1], metres[1:], seed),
    }
    side = min(shifted, key=shifted.__getitem__)
    if shifted[side] < _MUCH_BETTER * as_they_are:
        return (
            f"each fits the image {side} it: nine in ten then fit to {shifted[side]:.2g} m instead of "
            f"{as_they_are:.2g} m"
        )
    return ""


def _most_distances(centres: FloatArray, metres: FloatArray, seed: int) -> float:
    """Distance that nine in ten positions are within."""
    return float(np.quantile(_distances(centres, metres, seed), _MOST))


def _median_distance(centres: FloatArray, metres: FloatArray, seed: int) -> float:
    return float(np.median(_distances(centres, metres, seed)))


def _distances(centres: FloatArray, metres: FloatArray, seed: int) -> FloatArray:
    """Distances (n,) from the positions by the similarity that most agree with."""
    good = agreeing_pairs(centres, metres, seed=seed)
    try:
        placed = fit_similarity(centres[good], metres[good])
    except InvalidArgument:  # on a line: there is no other hand
        return np.full(len(centres), np.inf)
    return np.asarray(np.linalg.norm(placed.apply(centres) - metres, axis=1))
