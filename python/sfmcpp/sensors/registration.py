"""Metric registration of a map with a sensor, from the first poses: thesis §5.3.3, eqs 5.16–5.19.

The thesis takes rotation and translation from the last pair alone and says that a fit to all would be better
(§5.3.3.1): here it is one. Apply the result with :meth:`Similarity.apply_to_poses` (eq. 5.16) and
:meth:`Similarity.apply` to the points (eq. 5.17).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry.similarity import THINNEST_EXTENT, PointMoments, Similarity, fit_pose_similarity
from sfmcpp.geometry.so3 import nearest_rotation
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import ANY, FloatArray, finite_array

# N_recal of the thesis.
PAIRS = 6
# A scale that may be off by more than this share is none: the way gone is too short for the noise.
LARGEST_RELATIVE_SIGMA = 0.2
# Cameras on vehicles and in hands stand upright to about this; a roll that positions tell worse is open.
OPEN_ROLL_RAD = float(np.deg2rad(5.0))
# The y axis of a camera points down.
UP_IN_CAMERA = (0.0, -1.0, 0.0)
# Sine of the angle between the path and "up" below which one says nothing of the roll about the other: 10°.
_LEAST_ACROSS = 0.17


@dataclass(frozen=True, eq=False)
class Registration:
    """A similarity world_from_map and how well the pairs agree with it.

    Attributes
    ----------
    similarity : Similarity
        What to apply to poses and points.
    residuals_m : (n,) float64
        Distance left between the positions of each pair [m]; of each step, if only distances were given.
    relative_sigma : float
        What the scale may be off, as a share of it, by the residuals; by positions alone also what the
        direction of the path may be off [rad].
    roll_sigma_rad : float
        What the rotation about the line of the path may be off, by the positions [rad]: infinite on a
        straight line; 0 where orientations tell it.
    upright : bool
        Whether that rotation was taken from the cameras standing upright, because positions left it open.
    """

    similarity: Similarity
    residuals_m: FloatArray
    relative_sigma: float = 0.0
    roll_sigma_rad: float = 0.0
    upright: bool = False

    @property
    def rmse_m(self) -> float:
        """Root mean square of the residuals [m]."""
        return float(np.sqrt(np.mean(self.residuals_m**2)))


@checked()
def register_by_poses(vision: ArrayLike, measured: ArrayLike, pairs: int = PAIRS) -> Registration:
    """Register by poses: an INS, or an odometer and a gyroscope integrated.

    The orientations tell the rotation, on a straight line too.

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
        If there are fewer than `pairs`, a shape is wrong, or the camera moved too little to tell a scale.
    """
    source = _leading_poses("vision", vision, pairs, 2)
    target = _leading_poses("measured", measured, pairs, 2)
    moments = _moments_of_motion(source[:, :, 3], target[:, :, 3])
    similarity = fit_pose_similarity(source, target)
    residuals = _distances(similarity.apply(source[:, :, 3]), target[:, :, 3])
    # The positions leave three numbers of the translation and the scale to the residuals.
    noise = _noise(residuals, 4)
    return Registration(similarity, residuals, _relative_sigma(moments, similarity.scale, noise))


@checked()
def register_by_positions(
    vision: ArrayLike,
    measured: ArrayLike,
    pairs: int = PAIRS,
    up: ArrayLike | None = None,
    up_in_camera: ArrayLike = UP_IN_CAMERA,
) -> Registration:
    """Register by positions alone, from a GPS.

    On a straight street positions leave the rotation about its line open. Where they tell it worse than
    `OPEN_ROLL_RAD`, the cameras are taken as upright in the mean; all else is the least-squares fit.

    Parameters
    ----------
    vision : (n, 3, 4) array-like
        Poses world_from_camera of the map, n ≥ `pairs`.
    measured : (n, 3) array-like
        Positions of the same cameras [m].
    pairs : int
        How many of the first ones to use, at least 3.
    up : (3,) array-like, optional
        Direction in the world of `measured` that is up. Without it the path must bend.
    up_in_camera : (3,) array-like
        Direction in the camera's frame that is up where it stands upright. Default: against its y axis.

    Returns
    -------
    Registration
        :attr:`Registration.upright` tells whether `up` was needed.

    Raises
    ------
    InvalidArgument
        If there are fewer than `pairs`, a shape is wrong, the camera moved too little for the noise of the
        positions, or it went straight and there is no `up`, or straight along `up`.
    """
    poses = _leading_poses("vision", vision, pairs, 3)
    source, target = poses[:, :, 3], finite_array("measured", measured, (ANY, 3))[:pairs]
    if len(target) < pairs:
        raise InvalidArgument(f"measured: there are {len(target)} positions, must be {pairs} or more")
    moments = _moments_of_motion(source, target)
    free = _registration_of_rotation(moments, nearest_rotation(moments.covariance), source, target)
    if free.roll_sigma_rad <= OPEN_ROLL_RAD:
        return free
    if up is None:
        raise InvalidArgument(
            "measured: the positions lie on a line to within their noise, about which any rotation fits: the "
            "path must bend, or `up` be given"
        )
    in_map = (poses[:, :, :3] @ finite_array("up_in_camera", up_in_camera, (3,))).mean(axis=0)
    rotation = _upright_rotation(moments.covariance, in_map, finite_array("up", up, (3,)))
    return _registration_of_rotation(moments, rotation, source, target, upright=True)


@checked()
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
    centres = _leading_poses("vision", vision, pairs, 2)[:, :, 3]
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


def _leading_poses(name: str, poses: ArrayLike, pairs: int, fewest: int) -> FloatArray:
    if pairs < fewest:
        raise InvalidArgument(f"pairs = {pairs}: must be at least {fewest}")
    array = finite_array(name, poses, (ANY, 3, 4))
    if len(array) < pairs:
        raise InvalidArgument(f"{name}: there are {len(array)} poses, must be {pairs} or more")
    return array[:pairs]


def _moments_of_motion(source: FloatArray, target: FloatArray) -> PointMoments:
    """Moments of pairs of positions, of which neither side stands still."""
    moments = PointMoments.of(source, target)
    for name, mean, extents in (
        ("vision", moments.source_mean, moments.source_extents),
        ("measured", moments.target_mean, moments.target_extents),
    ):
        if not extents[0] > THINNEST_EXTENT * np.linalg.norm(mean):
            raise InvalidArgument(f"{name}: all {len(source)} positions are the same, no scale can be told")
    return moments


def _registration_of_rotation(
    moments: PointMoments, rotation: FloatArray, source: FloatArray, target: FloatArray, upright: bool = False
) -> Registration:
    scale = moments.scale(rotation)
    similarity = Similarity(scale, rotation, moments.translation(rotation, scale))
    residuals = _distances(similarity.apply(source), target)
    noise = _noise(residuals, 7)
    relative = _relative_sigma(moments, scale, noise)
    along, *across = moments.source_extents
    arm = scale * np.sqrt(len(source)) * float(np.linalg.norm(across))
    roll = noise / arm if np.linalg.norm(across) > THINNEST_EXTENT * along else np.inf
    return Registration(similarity, residuals, relative, float(roll), upright)


def _upright_rotation(
    covariance: FloatArray, up_in_source: FloatArray, up_in_target: FloatArray
) -> FloatArray:
    """Rotation (3, 3) that brings one line onto another and one "up" as near to the other as the lines allow.

    The first singular vectors of `covariance`, target sourceᵀ, are the directions of the lines.
    """
    left, _, right = np.linalg.svd(covariance)
    source = _frame("up_in_camera", right[0], up_in_source)
    target = _frame("up", left[:, 0], up_in_target)
    return np.asarray(target @ source.T)


def _frame(name: str, line: FloatArray, up: FloatArray) -> FloatArray:
    """Right-handed frame (3, 3): the line, "up" as far as it is across the line, and the normal of both."""
    across = up - (up @ line) * line
    length = float(np.linalg.norm(across))
    if not length > _LEAST_ACROSS * np.linalg.norm(up):
        raise InvalidArgument(f"{name}: is zero or along the path, must point across it to tell the roll")
    across /= length
    return np.stack([line, across, np.cross(line, across)], axis=1)


def _noise(residuals: FloatArray, parameters: int) -> float:
    """Standard deviation of a coordinate, from what `parameters` fitted numbers have left of it [m]."""
    return float(np.sqrt(residuals @ residuals / (3 * len(residuals) - parameters)))


def _relative_sigma(moments: PointMoments, scale: float, noise: float) -> float:
    """Relative standard deviation of the scale; InvalidArgument where it is too large."""
    extent = scale * np.sqrt(len(moments.shares) * moments.source_variance)
    if not noise <= LARGEST_RELATIVE_SIGMA * extent:
        raise InvalidArgument(
            f"measured: {len(moments.shares)} positions spread over {np.sqrt(moments.target_variance):.3g} m "
            f"differ by {noise:.3g} m from the map's: too much to tell a scale; must be spread wider"
        )
    return float(noise / extent)


def _distances(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(one - other, axis=1))
