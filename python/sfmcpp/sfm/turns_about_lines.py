"""How far positions near a line leave a model free to turn about it."""

from __future__ import annotations

import numpy as np

from sfmcpp.model.arrays import FloatArray

# Positions lie near a line where a model may be turned about it by more than this [deg], and by so many times
# more than about other axes.
_MUCH_TURNED_DEG, _MUCH_MORE = 2.0, 3.0
# Beyond this any angle is possible, and which side is up is no evidence of anything [deg].
OPEN_DEG = 10.0
_TURNED = (
    "the positions are {:.2g} m off a line in the root mean square, and scatter by {:.2g} m: the model may "
    "be turned about that line by {}; positions of a second line, or control points (--gcp), hold it"
)


def turn_sigmas_deg(centres: FloatArray, weights: FloatArray, sigma_m: float) -> FloatArray:
    """Standard deviations (3,) of the turns of a model that its positions hold, largest first [deg].

    Parameters
    ----------
    centres : (n, 3) float64
        Centres of the cameras in the model [m].
    weights : (n, 3) float64
        Of the coordinates of their positions.
    sigma_m : float
        How these scatter, a coordinate of weight one [m].

    Returns
    -------
    (3,) float64
        The first is infinite where the cameras lie on a line exactly.
    """
    around = centres - centres.mean(axis=0)
    moved = np.cross(np.eye(3)[None], around[:, None])  # by a turn about each axis
    held = np.linalg.eigvalsh(np.einsum("nka,na,nla->kl", moved, weights, moved))
    sigmas = np.full(3, np.inf)
    np.divide(sigma_m, np.sqrt(np.maximum(held, 0)), out=sigmas, where=held > 0)
    return np.asarray(np.degrees(sigmas))


def turn_warning(centres: FloatArray, sigmas_deg: FloatArray, sigma_m: float) -> list[str]:
    """Warn where positions lie so near a line that the model may be turned about it.

    Parameters
    ----------
    centres : (n, 3) float64
        Centres of the cameras in the model [m].
    sigmas_deg : (3,) float64
        Of :func:`turn_sigmas_deg`.
    sigma_m : float
        How the positions scatter [m].

    Returns
    -------
    list of str
        A sentence, or nothing.
    """
    if sigmas_deg[0] <= max(_MUCH_TURNED_DEG, _MUCH_MORE * sigmas_deg[1]):
        return []
    off_m = np.linalg.svd(centres - centres.mean(axis=0), compute_uv=False)[1:] / np.sqrt(len(centres))
    is_any = sigmas_deg[0] > 3 * OPEN_DEG
    angle = "any angle" if is_any else f"±{sigmas_deg[0]:.1f}° (one standard deviation)"
    return [_TURNED.format(float(np.hypot(*off_m)), sigma_m, angle)]
