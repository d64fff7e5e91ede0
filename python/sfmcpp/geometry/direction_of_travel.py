"""Direction in which a camera has moved between two images, and what it may be off."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from sfmcpp.geometry import so3
from sfmcpp.geometry._matches import checked_matches
from sfmcpp.geometry.epipolar import sampson_terms
from sfmcpp.geometry.significance import mad_sigma
from sfmcpp.model.arguments import checked
from sfmcpp.model.arrays import FloatArray

# Fewer matches leave the direction open.
_FEWEST_MATCHES = 15
# A tenth of a milliradian is a twentieth of what directions are off.
_MOST_STEPS, _SMALL_STEP, _LARGEST_STEP = 15, 1e-4, 0.2
# Noise of a match is no less [px]; off by as many standard deviations, it loses three quarters of its weight.
_LEAST_NOISE_PX, _LOSS_SIGMAS = 0.05, 2.0
_DIFFERENCE = 1e-6


@dataclass(frozen=True, eq=False)
class Travel:
    """Motion of a camera between two images.

    Attributes
    ----------
    rotation : (3, 3) float64
        Of the second camera in the frame of the first.
    direction : (3,) float64
        Unit vector from the first centre to the second, in the frame of the first.
    covariance : (3, 3) float64
        Of `direction`, with the rotation as open as the matches leave it.
    """

    rotation: FloatArray
    direction: FloatArray
    covariance: FloatArray


@checked(intrinsics=(-1,), camera=(3, 4))
def refine_travel(
    pixels_1: ArrayLike, pixels_2: ArrayLike, intrinsics: FloatArray, camera: FloatArray
) -> Travel | None:
    """Improve a motion by all matches of two images: least squares of Sampson errors with a robust loss.

    It ends after 15 steps, converged or not: what is left to go is then a fraction of σ for most images, but
    several σ for one in a hundred, as where two minima are near: whoever uses many must bear such outliers.

    Parameters
    ----------
    pixels_1, pixels_2 : (N, 2) float64
        Images of the same N points before and after [px]; some may be wrong.
    intrinsics : (5,) or (12,) float64
        Of the camera.
    camera : (3, 4) float64
        The second camera in the frame of the first, as far as it is known; ‖c‖ does not matter.

    Returns
    -------
    Travel or None
        None where there are too few matches, the camera stands, or the matches do not tell the motion.

    Raises
    ------
    InvalidArgument
        If a shape is wrong or a number is not finite.
    """
    matches = checked_matches(pixels_1, pixels_2, intrinsics, None)
    length = float(np.linalg.norm(camera[:, 3]))
    if len(matches) < _FEWEST_MATCHES or length == 0:
        return None
    first, second = (rays / rays[:, 2:] for rays in matches.rays)
    rotation, direction = camera[:, :3], camera[:, 3] / length
    step = np.full(5, np.inf)
    for _ in range(_MOST_STEPS):
        across = np.linalg.svd(direction[None])[2][1:].T
        errors, slopes = _linearised((first, second), rotation, direction, across, matches.focal_px)
        noise = max(mad_sigma(errors), _LEAST_NOISE_PX)
        weighted = slopes * (1 + (errors / (_LOSS_SIGMAS * noise)) ** 2)[:, None] ** -2
        information = weighted.T @ slopes
        if np.linalg.cond(information) > 1 / _DIFFERENCE**2:
            return None
        if np.linalg.norm(step) < _SMALL_STEP:
            break
        step = -np.linalg.solve(information, weighted.T @ errors)
        if np.linalg.norm(step) > _LARGEST_STEP:
            return None
        rotation, direction = rotation @ so3.exp(step[:3]), _turned(direction, across, step[None, 3:])[0]
    covariance = across @ np.linalg.inv(information)[3:, 3:] @ across.T * noise**2
    return Travel(rotation, direction, np.asarray(covariance))


def _linearised(
    rays: tuple[FloatArray, FloatArray],
    rotation: FloatArray,
    direction: FloatArray,
    across: FloatArray,
    focal_px: float,
) -> tuple[FloatArray, FloatArray]:
    """Errors (N,) [px], and their derivatives (N, 5) by the rotation and across the direction."""
    steps = np.vstack([np.zeros(5), _DIFFERENCE * np.eye(5)])
    essentials = so3.hat(_turned(direction, across, steps[:, 3:])) @ (rotation @ so3.exp(steps[:, :3]))
    algebraic, slope = sampson_terms(essentials[:, None], *rays)
    errors = focal_px * algebraic / np.maximum(slope, np.finfo(float).tiny)
    return errors[0], (errors[1:] - errors[0]).T / _DIFFERENCE


def _turned(direction: FloatArray, across: FloatArray, steps: FloatArray) -> FloatArray:
    """Directions (n, 3) after steps (n, 2) across."""
    turned = direction + steps @ across.T
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))
