"""Points and matches on one line: they leave a pose open however many they are.

A camera may turn round the line of its points. Where they lie beside it only by their noise, or all but one
do, which a turn meets, a pose fits them all and means nothing. So what counts is how well the pixels beside
the line hold that turn.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.model.arrays import BoolArray, FloatArray

# Largest standard deviation of a turn round the line [rad]: 3 degrees.
_LARGEST_SIGMA = 0.05
# Errors below this part of the threshold are rounding.
_EXACT = 1e-3
# Of a point that outweighs all others by more, these are taken to be this part of all.
_LEAST_REST = 1e-9
# Two matches beside a line are met by what it leaves open of a relative pose.
_MATCHES_MET = 2


def turn_is_open(
    points: FloatArray, depths: FloatArray, errors_px: FloatArray, focal_px: float, threshold_px: float
) -> bool:
    """Whether world points hold a camera too loosely against turns round the line they are nearest to.

    Parameters
    ----------
    points : (N, 3) float64
        World points that a pose explains, N ≥ 4.
    depths : (N,) float64
        Their depths in the camera, positive.
    errors_px : (N,) float64
        Their reprojection errors [px].
    focal_px : float
        Focal length [px].
    threshold_px : float
        Largest of the errors [px].

    Returns
    -------
    bool
    """
    weights = (focal_px / depths) ** 2
    offsets = points - weights @ points / weights.sum()
    outer = weights[:, None, None] * offsets[:, :, None] * offsets[:, None, :]
    # Without one of the points the mean moves, too.
    share = 1 / np.maximum(1 - weights / weights.sum(), _LEAST_REST)
    beside = np.linalg.eigvalsh(outer.sum(axis=0) - share[:, None, None] * outer)[:, :2].sum(axis=1).min()
    freedom = max(2 * len(points) - 6, 1)
    return _is_open(beside, errors_px, threshold_px, freedom)


def pose_is_open(
    rays: tuple[FloatArray, FloatArray], errors_px: FloatArray, focal_px: float, threshold_px: float
) -> bool:
    """Whether matches lie so near one line in either image that they leave a relative pose open.

    Parameters
    ----------
    rays : two (N, 3) float64
        Unit vectors to the matches that a pose explains in either camera, N ≥ 5.
    errors_px : (N,) float64
        Their Sampson errors [px].
    focal_px : float
        Focal length [px].
    threshold_px : float
        Largest of the errors [px].

    Returns
    -------
    bool
    """
    beside = max(_beside_plane(vectors) for vectors in rays) * focal_px**2
    return _is_open(beside, errors_px, threshold_px, max(len(errors_px) - 5, 1))


def _beside_plane(rays: FloatArray) -> float:
    """Sum of squared sines between rays (N, 3) and their nearest plane, all but those that it may meet."""
    kept: BoolArray = np.ones(len(rays), dtype=np.bool_)
    outer = rays[:, :, None] * rays[:, None, :]
    total = outer.sum(axis=0)
    for _ in range(_MATCHES_MET):
        least = np.where(kept, np.linalg.eigvalsh(total - outer)[:, 0], np.inf)
        worst = int(np.argmin(least))
        kept[worst] = False
        total = total - outer[worst]
    return float(np.linalg.eigvalsh(total)[0])


def _is_open(beside_px2: float, errors_px: FloatArray, threshold_px: float, freedom: int) -> bool:
    sigma_px2 = max(float(errors_px @ errors_px) / freedom, (_EXACT * threshold_px) ** 2)
    return bool(sigma_px2 > _LARGEST_SIGMA**2 * beside_px2)
