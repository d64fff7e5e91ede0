"""Metric registration of a map by the first pairs of vision and sensor: thesis §5.3.3, eqs 5.16–5.19.

The thesis takes rotation and translation from the last pair alone and says that a fit to all would be better
(§5.3.3.1): here it is one. Apply the result with :meth:`Similarity.apply_to_poses` (eq. 5.16) and
:meth:`Similarity.apply` to the points (eq. 5.17).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Similarity, fit_pose_similarity, fit_similarity
from sfmcpp.model.arrays import ANY, finite_array
from sfmcpp.model.problem import FloatArray

# N_recal of the thesis.
PAIRS = 6


@dataclass(frozen=True, eq=False)
class Registration:
    """A similarity world_from_map and how well the pairs agree with it.

    Attributes
    ----------
    similarity : Similarity
        What to apply to poses and points.
    residuals_m : (n,) float64
        Distance left between the positions of each pair [m]; of each step, if only distances were given.
    """

    similarity: Similarity
    residuals_m: FloatArray

    @property
    def rmse_m(self) -> float:
        """Root mean square of the residuals [m]."""
        return float(np.sqrt(np.mean(self.residuals_m**2)))


def register_by_poses(vision: ArrayLike, measured: ArrayLike, pairs: int = PAIRS) -> Registration:
    """Register by poses: an INS, or an odometer and a gyroscope integrated.

    Parameters
    ----------
    vision : (n, 3, 4) array-like
        Poses world_from_camera of the map, n ≥ `pairs`.
    measured : (n, 3, 4) array-like
        What the sensor says of the same cameras.
    pairs : int
        How many of the first ones to use, at least 2.

    Returns
    -------
    Registration

    Raises
    ------
    InvalidArgument
        If there are fewer than `pairs`, a shape is wrong, or the camera did not move.
    """
    source, target = _first("vision", vision, pairs, 2), _first("measured", measured, pairs, 2)
    similarity = fit_pose_similarity(source, target)
    return Registration(similarity, _distances(similarity.apply(source[:, :, 3]), target[:, :, 3]))


def register_by_positions(vision: ArrayLike, measured: ArrayLike, pairs: int = PAIRS) -> Registration:
    """Register by positions alone, from a GPS: the path must bend.

    Parameters
    ----------
    vision : (n, 3, 4) array-like
        Poses world_from_camera of the map, n ≥ `pairs`.
    measured : (n, 3) array-like
        Positions of the same cameras [m].
    pairs : int
        How many of the first ones to use, at least 3.

    Returns
    -------
    Registration

    Raises
    ------
    InvalidArgument
        If there are fewer than `pairs`, a shape is wrong, or the positions lie on a line.
    """
    source = _first("vision", vision, pairs, 3)[:, :, 3]
    target = finite_array("measured", measured, (ANY, 3))[: len(source)]
    similarity = fit_similarity(source, target)
    return Registration(similarity, _distances(similarity.apply(source), target))


def register_by_distances(vision: ArrayLike, distances_m: ArrayLike, pairs: int = PAIRS) -> Registration:
    """Make a map metric by the distances of an odometer: the ratio of the mean steps, thesis eq. 5.19.

    Parameters
    ----------
    vision : (n, 3, 4) array-like
        Poses world_from_camera of the map, n ≥ `pairs`.
    distances_m : (n − 1,) array-like
        Measured distance from each pose to the next [m].
    pairs : int
        How many of the first poses to use, at least 2.

    Returns
    -------
    Registration
        A change of scale that leaves the first camera where it is.

    Raises
    ------
    InvalidArgument
        If there are fewer than `pairs`, a shape is wrong, or either side says that nothing moved.
    """
    centres = _first("vision", vision, pairs, 2)[:, :, 3]
    seen = _distances(centres[1:], centres[:-1])
    driven = np.abs(finite_array("distances_m", distances_m, (ANY,))[: len(seen)])
    if len(driven) < len(seen):
        raise InvalidArgument(f"distances_m: there are {len(driven)}, must be {len(seen)} or more")
    for name, total in (("vision", seen.sum()), ("distances_m", driven.sum())):
        if not total > 0:
            raise InvalidArgument(f"{name}: nothing moved in the first {pairs} poses, no scale can be told")
    scale = float(driven.sum() / seen.sum())
    similarity = Similarity(scale, np.eye(3), (1 - scale) * centres[0])
    return Registration(similarity, np.abs(scale * seen - driven))


def _first(name: str, poses: ArrayLike, pairs: int, fewest: int) -> FloatArray:
    if pairs < fewest:
        raise InvalidArgument(f"pairs = {pairs}: must be at least {fewest}")
    array = finite_array(name, poses, (ANY, 3, 4))
    if len(array) < pairs:
        raise InvalidArgument(f"{name}: there are {len(array)} poses, must be {pairs} or more")
    return array[:pairs]


def _distances(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(one - other, axis=1))
