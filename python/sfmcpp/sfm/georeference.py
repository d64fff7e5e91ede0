"""Positions of images bring a model into the world; how far they are to be trusted, the data tell.

A similarity that most positions agree with (least median of squares, Rousseeuw 1984) moves the model there.
Then images and positions are adjusted together with the weight that restricted likelihood gives the
positions, and those farther from where the model has their images than that explains are left out, until
none is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfmcpp.ba.check import residuals
from sfmcpp.ba.linearize import linearize
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import Similarity, agreeing_pairs, fit_similarity
from sfmcpp.map import LocalProblem, Map
from sfmcpp.model import ConstraintGroup
from sfmcpp.model.arrays import BoolArray, FloatArray
from sfmcpp.sensors.gps import east_north_up
from sfmcpp.sfm.adjusting import FINE
from sfmcpp.sfm.result import GpsOutcome
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.weighting import solve

# Fewer positions leave nothing to judge them by.
LEAST_POSITIONS = 5
# Centres lie on a line where their second spread is below this part of their first.
_LINE = 0.01
# Standard deviations, of a coordinate, beyond which a position lies: one of 10,000 honest ones does.
_LIE_SIGMAS = 4.6
_ROUNDS = 8


@dataclass(frozen=True, eq=False)
class Positions:
    """Positions of images in a metric frame.

    Attributes
    ----------
    metres : (I, 3) float64
        East, north, up of the origin, or in the user's frame [m]; not a number where unknown.
    origin : (3,) float64
        Latitude, longitude [deg, WGS84] and height [m] of the origin; not a number of a frame of the user's.
    """

    metres: FloatArray
    origin: FloatArray


def positions_of(
    names: list[str], known: Mapping[str, tuple[float, float, float]], *, geodetic: bool
) -> Positions:
    """Put positions of images in the order of the images.

    Parameters
    ----------
    names : list of I str
        Names of images.
    known : mapping
        Positions by name; names that are no image's are left alone.
    geodetic : bool
        Whether they are latitude, longitude [deg, WGS84] and height [m]; else x, y, z [m].

    Returns
    -------
    Positions
        Geodetic ones in the tangent plane of their mean.

    Raises
    ------
    InvalidArgument
        If no name is an image's, or a latitude is out of range.
    """
    rows = np.array([known.get(name, (np.nan,) * 3) for name in names]).reshape(-1, 3)
    told = np.isfinite(rows[:, 0])
    if not told.any():
        listed = ", ".join(list(known)[:3])
        raise InvalidArgument(f"gps: none of its names ({listed}) is the name of an image")
    if not geodetic:
        return Positions(rows, np.full(3, np.nan))
    origin = np.asarray(rows[told].mean(axis=0))
    metres = np.full(rows.shape, np.nan)
    metres[told] = east_north_up(rows[told], origin)
    return Positions(metres, origin)


def georeference(world: Map, positions: Positions, settings: IncrementalSettings) -> GpsOutcome:
    """Bring a model into the world of positions of its images, and adjust both together.

    Parameters
    ----------
    world : Map
        It is moved and adjusted.
    positions : Positions
        Of all images of the map, as far as they are known.
    settings : IncrementalSettings
        Scale of the loss, seed.

    Returns
    -------
    GpsOutcome
        What the positions amount to, and which of them lie.

    Raises
    ------
    InvalidArgument
        If there are too few positions, or they lie on a line, which leaves the model free to turn round it.
    """
    images = np.flatnonzero(world.registered & np.isfinite(positions.metres[:, 0]))
    _require_enough(positions.metres[images])
    good = _placed(world.poses[images][:, :, 3], positions.metres[images], settings)[1]
    for _ in range(_ROUNDS):
        # A step of the adjustment turns no whole model without bending it: all that is left for it is little.
        world.transform(fit_similarity(world.poses[images[good]][:, :, 3], positions.metres[images[good]]))
        sigma_m, accuracy_m = _adjust(world, images[good], positions.metres, settings)
        apart = np.linalg.norm(world.poses[images][:, :, 3] - positions.metres[images], axis=1)
        agrees = apart <= _LIE_SIGMAS * np.sqrt(3) * sigma_m
        if (agrees == good).all():
            break
        good = agrees
    names = [world.image_names[image] for image in images]
    return GpsOutcome(
        sigma_m=sigma_m,
        accuracy_m=accuracy_m,
        outliers=[name for name, agree in zip(names, good, strict=True) if not agree],
        origin=positions.origin,
        residuals_m={name: float(distance) for name, distance in zip(names, apart, strict=True)},
    )


def _require_enough(metres: FloatArray) -> None:
    if len(metres) < LEAST_POSITIONS:
        raise InvalidArgument(
            f"gps: {len(metres)} images of the model have a position, {LEAST_POSITIONS} are needed"
        )
    spread = np.linalg.svd(metres - np.median(metres, axis=0), compute_uv=False)
    if spread[1] <= _LINE * spread[0]:
        raise InvalidArgument(
            "gps: the positions lie on a line, which leaves the model free to turn round it"
        )


def _placed(
    centres: FloatArray, metres: FloatArray, settings: IncrementalSettings
) -> tuple[Similarity, BoolArray]:
    """Similarity that brings most `centres` (n, 3) to `metres` (n, 3), and which of them it does (n,)."""
    good = agreeing_pairs(centres, metres, seed=settings.seed)
    try:
        return fit_similarity(centres[good], metres[good]), good
    except InvalidArgument as error:
        raise InvalidArgument(f"gps: no positions tell where the model is: {error}") from error


def _adjust(
    world: Map, images: NDArray[np.intp], metres: FloatArray, settings: IncrementalSettings
) -> tuple[float, float]:
    """Adjust images and positions together; σ of a coordinate of a position, and of a centre [m]."""
    local = world.whole_problem(2)
    cameras = np.searchsorted(local.images, images).astype(np.int32)
    group = ConstraintGroup("position", cameras, metres[images], name="gps")
    loss: dict[str, Any] = {"loss": "cauchy", "loss_scale_px": settings.loss_sigmas}
    summary = solve(local.problem, constraints=[group], weight="auto", **loss, **FINE)
    (chosen,) = summary.require_uninterrupted().group_weights
    world.take(local)
    return chosen.sensor_sigma, _centre_sigma_m(local, group, loss)


def _centre_sigma_m(local: LocalProblem, group: ConstraintGroup, loss: Mapping[str, Any]) -> float:
    """Standard deviation of a coordinate of a camera's centre in the world, RMS over the images [m]."""
    model = linearize(local.problem, constraints=[group], **loss)
    variances = [np.diag(block)[3:6] for block in model.covariance(cameras="all").cameras]
    return float(np.sqrt(np.mean(variances) * _pixel_variance(local, loss)))


def _pixel_variance(local: LocalProblem, loss: Mapping[str, Any]) -> float:
    """Variance of a coordinate of an observation, over that which it was taken to have."""
    problem = local.problem
    squared = (residuals(problem) ** 2).sum(axis=1)
    weights = 1 / (1 + squared / loss["loss_scale_px"] ** 2)
    parameters = 6 * problem.num_cameras + 3 * problem.num_points
    return float((weights * squared).sum() / (2 * problem.num_observations - parameters))
