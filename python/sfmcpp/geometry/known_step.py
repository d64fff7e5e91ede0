"""Rotation between two images whose step is known, as from an odometer.

A step to the side and a turn move distant points alike. With the step given, three angles are left, and some
ten matches hold them to hundredths of a degree, where without it they leave tenths or whole degrees open.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.geometry._matches import checked_matches
from sfmcpp.geometry.so3 import exp
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray
from sfmcpp.model.checks import require_rotation

_ROUNDS = 10
# Errors to which matches count fully are at least this, and their median where that is larger [px].
_NOISE_PX = 0.5
# Three angles need as many matches, and one more to deny a wrong one.
_FEWEST = 4
# Matches on one line through the epipole leave an angle open, and at the epipole all three: this share of the
# others, and at least this much, keeps it as it is.
_LIFT, _LEAST_LIFT = 1e-6, 1e-12
# Sums of two squared sines are no smaller: what is seen at the epipole itself moves anywhere.
_AT_EPIPOLE = 1e-12


@checked(camera=(3, 4))
def rotation_of_step(
    pixels_1: ArrayLike, pixels_2: ArrayLike, intrinsics: ArrayLike, camera: FloatArray
) -> FloatArray:
    """Refine the rotation between two images, the direction of the step given.

    Sampson errors with Cauchy's weights, at the scale of their median.

    Parameters
    ----------
    pixels_1, pixels_2 : (N, 2) float64
        Images of the same N points before and after [px].
    intrinsics : (5,) float64
        ``(f, aspect, cx, cy, skew)``, or with distortion; see :func:`sfmcpp.geometry.relative_pose`.
    camera : (3, 4) float64
        ``[R | c]`` of the second camera in the frame of the first: the rotation as far as it is known, and
        the step in any unit.

    Returns
    -------
    (3, 3) float64
        The rotation of the second camera; that of `camera` where there are fewer than four matches or the
        step is none.

    Raises
    ------
    InvalidArgument
        If a shape is wrong, a number is not finite, or ``camera[:, :3]`` is no rotation.
    """
    matches = checked_matches(pixels_1, pixels_2, intrinsics, None)
    rotation, step = np.array(camera[:, :3]), camera[:, 3]
    require_rotation("camera[:, :3]", rotation)
    if len(matches) < _FEWEST or not step.any():
        return rotation
    rays, direction = matches.rays, step / np.linalg.norm(step)
    for _ in range(_ROUNDS):
        rotation = exp(_correction(*rays, rotation, direction, matches.focal_px)) @ rotation
    return rotation


def _correction(
    rays_1: FloatArray, rays_2: FloatArray, rotation: FloatArray, direction: FloatArray, focal_px: float
) -> FloatArray:
    """Rotation vector (3,) of a Gauss-Newton step, by the distances of rays from their epipolar planes."""
    turned, across = rays_2 @ rotation.T, np.cross(rays_1, direction)
    cosines = np.column_stack([rays_1 @ direction, turned @ direction])
    # Of the triple product of both rays and the direction, to make of it a distance in the images.
    scale = focal_px / np.sqrt(np.maximum(2.0 - np.sum(cosines**2, axis=1), _AT_EPIPOLE))
    errors, slopes = scale * np.sum(across * turned, axis=1), scale[:, None] * np.cross(turned, across)
    limit_px = max(_NOISE_PX, float(np.median(np.abs(errors))))
    weighted = slopes / (1.0 + (errors / limit_px) ** 2)[:, None]
    normal = weighted.T @ slopes
    lift = max(_LIFT * float(np.trace(normal)), _LEAST_LIFT)
    return -np.linalg.solve(normal + lift * np.eye(3), weighted.T @ errors)
