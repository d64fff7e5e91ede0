"""Checks of positions of images: redundancy, undecidable positions, single wrong ones, swapped axes.

How far the others check a coordinate is its redundancy number (W. Förstner and B. Wrobel, "Photogrammetric
Computer Vision", 2016): the part of an error in it that is left in its residual once a similarity is
fitted to all. Where the others lie on a line it is zero for what a turn about that line moves.

Swapped axes mirror the positions. Those of a flight lie near a plane, which a half turn about an axis in it
mirrors as well: they then fit, but the ground is above the cameras.
"""

from __future__ import annotations

import numpy as np

from sfmcpp.ba.linearize import LinearModel
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import agreeing_pairs, fit_similarity
from sfmcpp.geometry.significance import students_limit
from sfmcpp.geometry.similarity import motions_of_positions
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.model.photos import natural_order
from sfmcpp.sensors.geocentric import doubt_of_geocentric
from sfmcpp.sensors.gps import doubt_of_radians
from sfmcpp.sfm.positions import Positions
from sfmcpp.sfm.rounded_positions import doubt_of_rounding
from sfmcpp.sfm.turns_about_lines import OPEN_DEG, turn_sigmas_deg, turn_warning
from sfmcpp.weighting.conflict import OUTLIER_SIGMAS
from sfmcpp.wording import counted, first_few

# Below it a coordinate counts as not checked; Förstner's usual bound.
_LEAST_REDUNDANCY = 0.1
# Of fewer numbers that the fit does not use up, no scatter is known.
_LEAST_FREE = 5.0
# Least sum of squares that a residual is compared with.
_NO_RESIDUAL = 1e-300
# A position is wrong that no similarity explains to this share of its distance from the others.
_UNEXPLAINED = 0.1
# Of fewer pairs, right positions of σ = 1 m in a flat scene fit a mirrored model as well by chance.
_LEAST_PAIRS = 8
_MUCH_BETTER = 0.5
_MOST = 0.9
# Mean height of a direction of unit length over all cameras: of what is up in images, and of where they look.
_HEADS_DOWN, _TO_THE_SKY = -0.3, 0.8
_MIRROR = np.array([1.0, 1.0, -1.0])
# Positions that a warning names at most, and of which single ones are judged at most.
_NAMED, _MOST_NAMES = 5, 300
UNCHECKED = (
    "the alignment of the model, such as its roll about the line of the other positions, depends on the "
    "position of {} alone: the others cannot verify it"
)
# So many wrong positions, and so great a share of all, have a common cause.
_MANY, _GREAT_PART = 3, 0.25
_DOUBTFUL = (
    "of {} these are too many for single wrong positions: do not trust where the model is before the cause "
    "is known (rows of other images, wrong axes, another datum, a bent model, a wrong principal point)"
)
# No receiver is wrong about itself by such a factor where its unit is right.
_OTHER_UNIT = 5.0
# Right positions never scatter by such a factor more than stated where there are enough of them.
_MUCH_SCATTER, _ENOUGH_FOR_SCATTER = 2.0, 10
_WRONG_SIGMA = (
    "the positions scatter by {:.3g} m where {:.3g} m is stated: check the unit of the stated σ, and, if "
    "they scatter more, times, lever arm and calibration (of stated σ only the ratios count)"
)
_DEVIATES = (
    "the position of {} is {:.3g} m from its image, {:.1f} standard deviations of what is left there: it is "
    "kept, but probably wrong, and the model follows it"
)
BLIND = "the position of {} is not used: its image sees no point, which leaves open where the image is"
NO_FIX = "the position of {} is at zero: left out, the receiver had no fix"
_UNREAD = (
    "the columns {} of the positions are not read: standard deviations are in sigma_x, sigma_y, sigma_z, in "
    "sigma_horizontal, sigma_vertical, or in one sigma"
)
_SWAPPED = {
    True: "latitude and longitude of the positions may be swapped, or the sign of one be wrong (south and "
    "west are negative)",
    False: "x and y of the positions may be swapped (x is east, y north), or z is not up",
}


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
    extent = np.linalg.norm(around, axis=1).max() or 1.0
    rows = np.sqrt(weights)[:, :, None] * motions_of_positions(around / extent)
    normals = np.swapaxes(rows, 1, 2) @ rows
    together = normals[trusted].sum(axis=0) + np.where(trusted[:, None, None], 0.0, normals)
    hats = rows @ np.linalg.pinv(together, hermitian=True) @ np.swapaxes(rows, 1, 2)
    return np.asarray(np.linalg.eigvalsh(hats)[:, -1] > 1 - _LEAST_REDUNDANCY)


def outlier_sigmas(redundancy: float) -> float:
    """How many standard deviations a coordinate of a right position may be off, given their scatter.

    Parameters
    ----------
    redundancy : float
        Numbers of the positions that the fit leaves over, from which the standard deviation was found;
        infinite where it is known. From few, as of three positions that happen to fit, it may be far too
        small: then Student's quantile counts.
    """
    return max(OUTLIER_SIGMAS, students_limit(redundancy))


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


def worst_deviation(apart: FloatArray, weights: FloatArray, hat: FloatArray) -> tuple[int, float]:
    """Find the position whose residual is least likely beside all others (data snooping, Baarda 1968).

    A residual is compared with its own standard deviation, not with that of the position: the model follows
    a wrong position, and the less the others hold it, the more. The scale is that of the others
    along the same axis: no wrong position hides behind itself, and heights are worse than the rest.

    Parameters
    ----------
    apart : (n, 3) float64
        Adjusted centres minus positions.
    weights : (n, 3) float64
        Of the coordinates of the positions.
    hat : (3n, 3n) float64
        Hat matrix of the positions in the adjustment.

    Returns
    -------
    int, float
        Its number, and the deviation as a number of standard normal deviates, whatever the redundancy.
    """
    left = np.eye(apart.size) - hat
    free = np.clip(np.diag(left), 0.0, 1.0).reshape(apart.shape).sum(axis=0) - 1
    if (free < _LEAST_FREE).any():
        return 0, 0.0
    residuals = np.sqrt(weights) * apart
    normal = np.stack([_deviates(residuals[:, k], left[k::3, k::3]) for k in range(3)], axis=1)
    worst = int(np.argmax(normal.max(axis=1)))
    return worst, float(normal[worst].max())


def _deviates(residuals: FloatArray, cofactors: FloatArray) -> FloatArray:
    """Residuals (n,) along an axis as normal deviates, each by the scale of the others.

    Their covariance is σ² `cofactors` (n, n), which is no projection: images hold the positions, too. So what
    a residual tells of the others by it is taken from these, and the rest counts as many as it has freedoms.
    """
    deviates = np.zeros(len(residuals))
    if not residuals.any():  # an axis along which nothing is left says nothing
        return deviates
    for k, residual in enumerate(residuals.tolist()):
        others = np.arange(len(residuals)) != k
        own, along = max(float(cofactors[k, k]), _LEAST_REDUNDANCY), cofactors[others, k]
        rest = residuals[others] - along * (residual / own)
        spread = cofactors[np.ix_(others, others)] - np.outer(along, along) / own
        trace = float(np.trace(spread))
        free = trace**2 / float(np.sum(spread**2))
        student = residual**2 / own * trace / max(float(rest @ rest), _NO_RESIDUAL)
        # Wallace's approximation of normal deviates by Student's.
        deviates[k] = np.sqrt(free * np.log1p(student / free)) * (8 * free + 1) / (8 * free + 3)
    return deviates


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


def _evidence_in_any_order(centres: FloatArray, metres: FloatArray, names: list[str], seed: int) -> str:
    """Evidence of shifted rows in the order of the cameras, or in that of the names of their images."""
    given = list(range(len(names)))
    by_name = sorted(given, key=lambda k: natural_order(names[k]))
    found = evidence_of_shifted_rows(centres, metres, seed=seed)
    if found or by_name == given:
        return found
    return evidence_of_shifted_rows(centres[by_name], metres[by_name], seed=seed)


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


def warnings_of_all(
    poses: FloatArray,
    centres: FloatArray,
    positions: Positions,
    names: list[str],
    sigma_m: float,
    seed: int,
) -> list[str]:
    """Warn of what is wrong with positions as a whole.

    Parameters
    ----------
    poses : (C, 3, 4) float64
        All cameras ``[R | c]`` world_from_camera in the world of the positions.
    centres : (n, 3) float64
        Of those that have `positions`.
    positions : Positions
        As stated.
    names : list of n str
        Of their images: tables may have them in this order, or in that of the cameras.
    sigma_m : float
        How they scatter, one coordinate [m].
    seed : int
        Of the search for those that agree.
    """
    metres = positions.metres
    warnings = [_UNREAD.format(", ".join(positions.unread))] if positions.unread else []
    turns = turn_sigmas_deg(centres, positions.member_weights, sigma_m)
    if radians := doubt_of_radians(positions.origin, metres) if positions.geodetic else []:
        warnings += radians
    else:
        warnings += turn_warning(centres, turns, sigma_m)
    warnings += doubt_of_rounding(positions)
    warnings += [] if positions.geodetic else doubt_of_geocentric(metres + positions.origin)
    if turns[0] <= OPEN_DEG and (swapped := evidence_of_swapped_axes(poses, centres, metres, seed=seed)):
        warnings.append(f"{_SWAPPED[positions.geodetic]}: {swapped}")
    if shifted := _evidence_in_any_order(centres, metres, names, seed):
        warnings.append(f"rows of the positions are those of other images: {shifted}")
    stated_m = positions.stated_sigma_m
    if stated_m is not None:
        most = _MUCH_SCATTER if len(metres) >= _ENOUGH_FOR_SCATTER else _OTHER_UNIT
        if sigma_m > most * stated_m or sigma_m < stated_m / _OTHER_UNIT:
            warnings.append(_WRONG_SIGMA.format(sigma_m, stated_m))
    return warnings


def deviation_warning(
    model: LinearModel, apart: FloatArray, weights: FloatArray, names: list[str]
) -> list[str]:
    """Name the position that deviates most from what the others tell, if by more than chance."""
    if len(names) > _MOST_NAMES:
        return []
    worst, deviation = worst_deviation(apart, weights, model.hat_matrix(0))
    if deviation <= OUTLIER_SIGMAS:
        return []
    return [_DEVIATES.format(names[worst], float(np.linalg.norm(apart[worst])), deviation)]


def disagreement_warning(wrong: list[str], count: int) -> list[str]:
    """Name the positions that were left out, of `count`; many of them put all in doubt."""
    if not wrong:
        return []
    positions = counted(len(wrong), "position disagrees", "positions disagree")
    doubt = ""
    if len(wrong) >= _MANY and len(wrong) > _GREAT_PART * count:
        doubt = f"; {_DOUBTFUL.format(count)}"
    return [f"{positions} with the images: left out {first_few(wrong, _NAMED)}{doubt}"]
