"""Georeferencing: a model moved and adjusted to positions of its images, with robust weights.

A similarity that most positions agree with (least median of squares, Rousseeuw 1984) moves the model there.
Then images and positions are adjusted together with the weight that restricted likelihood gives the
positions, and those farther from where the model has their images than that explains are left out, until
none is.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sfmcpp.ba import check
from sfmcpp.ba.linearize import LinearModel
from sfmcpp.ba.options import takes_options
from sfmcpp.ba.time_limit import TimeLimit
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import Similarity, agreeing_pairs, fit_similarity
from sfmcpp.map import Map
from sfmcpp.model import ConstraintGroup, Problem
from sfmcpp.model.arrays import BoolArray, FloatArray, shaped_array
from sfmcpp.model.checks import require_seed
from sfmcpp.model.selection import observing_cameras
from sfmcpp.sfm.adjustment import FINE, hold_of_few_images
from sfmcpp.sfm.fit_statistics import linear_model, pixel_variance
from sfmcpp.sfm.intrinsics_sigmas import an_image_of_each, intrinsics_sigmas_of
from sfmcpp.sfm.position_checks import (
    BLIND,
    NO_FIX,
    UNCHECKED,
    deviation_warning,
    disagreement_warning,
    outlier_sigmas,
    unchecked_positions,
    undecidable_positions,
    warnings_of_all,
)
from sfmcpp.sfm.positions import Positions, local_positions, require_enough_of_model, require_no_line
from sfmcpp.sfm.result import GpsOutcome
from sfmcpp.sfm.settings import IncrementalSettings
from sfmcpp.sfm.stops import heed_stop
from sfmcpp.weighting import solve

if TYPE_CHECKING:
    from typing_extensions import Unpack

    from sfmcpp._core import SolveKeywords

_Moved = Callable[[Similarity], None]
_ROUNDS = 8
# Cameras whose covariance tells the accuracy of all, at most.
_JUDGED = 300


@dataclass(frozen=True, eq=False)
class Georeferenced:
    """A problem in the world of positions of its cameras.

    Attributes
    ----------
    outcome : GpsOutcome
        Accuracy and outliers of the positions, and the origin of the world.
    group : ConstraintGroup
        The positions without the outliers, of kind "position", with the weight that was chosen: for any later
        solve of the problem.
    """

    outcome: GpsOutcome
    group: ConstraintGroup


@takes_options
def georeference(
    problem: Problem,
    positions: ArrayLike,
    *,
    geodetic: bool = False,
    sigmas_m: ArrayLike | None = None,
    seed: int = 0,
    **options: Unpack[SolveKeywords],
) -> Georeferenced:
    """Georeference a problem: align it to positions of its cameras and adjust both together, in place.

    The images are adjusted alone first. Then the problem is aligned to most of the positions, and adjusted
    with them at a weight chosen by restricted likelihood; outlier positions are left out.

    Parameters
    ----------
    problem : Problem
        With a metric camera model; no camera or point fixed. Afterwards it is in metres from
        ``outcome.origin``, which is stored in its metadata.
    positions : (C, 3) array-like
        x, y, z [m] of each camera, or latitude, longitude [deg, WGS84] and height [m]; NaN where unknown. At
        least five, not on a line.
    geodetic : bool
        Whether positions are latitude, longitude and height; the world axes are then east, north, up.
    sigmas_m : (C, 3) array-like, optional
        Standard deviations along the world axes as stated by the receiver [m]. They count relative to one
        another, and their common factor is estimated. Default: all equal.
    seed : int
        Random seed of the search for positions that agree.
    **options

    Returns
    -------
    Georeferenced
        The outcome, and the constraint group of the positions.

    Raises
    ------
    InvalidArgument
        If an argument breaks a rule, too few positions are known or they lie on a line.
    KeyboardInterrupt
        On Ctrl-C.
    """
    require_seed(seed)
    require_movable(problem)
    if not isinstance(geodetic, bool | np.bool_):
        raise InvalidArgument(f"geodetic = {geodetic!r}: must be True or False")
    known = local_positions(
        _position_rows("positions", positions, problem), geodetic, _sigmas(sigmas_m, problem)
    )
    return georeference_to(problem, known, seed, **options)


def georeference_to(
    problem: Problem, positions: Positions, seed: int = 0, **options: Unpack[SolveKeywords]
) -> Georeferenced:
    """:func:`georeference` by positions that are in a metric frame already."""
    require_movable(problem)
    # Refuses too few positions, before the problem is changed.
    georeferencing = _Georeferencing(problem, positions, image_names(problem), seed)
    limit = TimeLimit(options.get("max_seconds"))
    summary = solve(problem, **options).require_uninterrupted()
    return georeferencing.run(dict(options), summary.loss_scale_px, lambda _: None, limit)


def georeference_map(world: Map, positions: Positions, settings: IncrementalSettings) -> GpsOutcome:
    """Bring a model into the world of positions of its images, and adjust both together.

    Parameters
    ----------
    world : Map
        It is moved and adjusted.
    positions : Positions
        Of all images of the map, as far as they are known.
    settings : IncrementalSettings
        Scale of the loss, how many images a camera needs, seed.

    Returns
    -------
    GpsOutcome
        Accuracy and outliers of the positions.

    Raises
    ------
    InvalidArgument
        If there are too few positions, or they lie on a line, which leaves the model free to turn round it.
    """
    local = world.whole_problem(2)
    hold_of_few_images(local.problem, settings)
    names = [world.image_names[image] for image in local.images]
    options = {"loss": "cauchy", "loss_scale_px": settings.loss_sigmas, "callback": heed_stop, **FINE}
    of_images = positions.of(local.images)
    # Points seen once are no part of the problem, and move with it all the same.
    georeferencing = _Georeferencing(local.problem, of_images, names, settings.seed)
    found = georeferencing.run(options, settings.loss_sigmas, world.transform, TimeLimit(None))
    world.take(local)
    world.origin = found.outcome.world_origin
    return found.outcome


def image_names(problem: Problem) -> list[str]:
    """Names of the images of a problem; their numbers from 0 where its file has none."""
    return list(problem.metadata.image_names) or [str(camera) for camera in range(problem.num_cameras)]


def _position_rows(name: str, value: ArrayLike, problem: Problem) -> FloatArray:
    return shaped_array(name, value, (problem.num_cameras, 3))


def _sigmas(value: ArrayLike | None, problem: Problem) -> FloatArray | None:
    return None if value is None else _position_rows("sigmas_m", value, problem)


def require_movable(problem: Problem) -> None:
    """Raise InvalidArgument where positions cannot move a problem: invalid, projective, or some is fixed."""
    check(problem)
    if not problem.is_metric:
        raise InvalidArgument(f"problem: {problem.camera_model} cameras have no positions to compare")
    for what, fixed in (("cameras", problem.fixed_cameras), ("points", problem.fixed_points)):
        if np.any(fixed):
            raise InvalidArgument(
                f"problem: {np.count_nonzero(fixed)} {what} are fixed, which positions would have to move"
            )


@dataclass(frozen=True, eq=False)
class _Fit:
    """A problem adjusted together with the positions of some of its n images that have one.

    Attributes
    ----------
    group : ConstraintGroup
        The positions adjusted with.
    sigma_m : float
        Their standard deviation [m].
    used : (n,) bool
        Which they are.
    agrees : (n,) bool
        Which positions agree with the adjusted problem.
    apart : (n, 3) float64
        Adjusted centres less positions [m].
    loss_scale_px : float
        Scale of the loss of the observations, as the adjustment had it.
    """

    group: ConstraintGroup
    sigma_m: float
    used: BoolArray
    agrees: BoolArray
    apart: FloatArray
    loss_scale_px: float


class _Georeferencing:
    """Moves and adjusts a problem whose images alone are adjusted, to positions of images by their names."""

    def __init__(self, problem: Problem, positions: Positions, names: list[str], seed: int) -> None:
        self._problem, self._positions, self._seed = problem, positions, seed
        sees = _see_points(problem)
        self._images = np.flatnonzero(positions.known & sees)
        self._blind = [names[image] for image in np.flatnonzero(positions.known & ~sees)]
        self._stated = positions.of(self._images)
        self._names, self._of_positions = names, [names[image] for image in self._images]
        require_enough_of_model(self._stated.metres)

    def run(
        self, options: dict[str, Any], loss_scale_px: float, moved: _Moved, limit: TimeLimit
    ) -> Georeferenced:
        """Georeference after a solve with these options and this scale; call `moved` after each move."""
        fit = self._fit(options, loss_scale_px, moved, limit)
        model = linear_model(self._problem, [fit.group], options, fit.loss_scale_px)
        outcome = self._outcome(fit, model)
        outcome.world_origin.put_into(self._problem.metadata)
        return Georeferenced(outcome, fit.group)

    def _fit(self, options: dict[str, Any], loss_scale_px: float, moved: _Moved, limit: TimeLimit) -> _Fit:
        """Adjust with the positions that agree, until these are the same as before."""
        problem, images = self._problem, self._images
        metres, weights = self._stated.metres, self._stated.member_weights
        good = agreeing_pairs(problem.centres[images], metres, seed=self._seed)
        good |= undecidable_positions(problem.centres[images], metres, weights, good)
        for _ in range(_ROUNDS):
            require_no_line(metres[good], self._named(~good))
            # A step of the adjustment turns no whole model without bending it: little is left for it.
            placed = _fitted_similarity(problem.centres[images[good]], metres[good], weights[good])
            placed.move(problem)
            moved(placed)
            group = ConstraintGroup(
                "position",
                images[good].astype(np.int32),
                metres[good],
                member_weights=weights[good],
                name="gps",
            )
            limited = limit.of(options)
            summary = solve(problem, constraints=[group], weight="auto", **limited).require_uninterrupted()
            found, loss_scale_px = summary.group_weights[0], summary.loss_scale_px
            sigma_m, redundancy = found.sensor_sigma, found.redundancy or 0.0
            apart = problem.centres[images] - metres
            misses = np.linalg.norm(apart * np.sqrt(weights), axis=1)
            agrees = misses <= outlier_sigmas(redundancy) * np.sqrt(3) * sigma_m
            agrees |= undecidable_positions(problem.centres[images], metres, weights, agrees)
            fit = _Fit(group, sigma_m, good, agrees, apart, loss_scale_px)
            if (agrees == good).all() or limit.is_over:
                break
            good = agrees
        return fit

    def _named(self, which: BoolArray) -> list[str]:
        """Names of some of the images that have a position, (n,)."""
        return [self._of_positions[k] for k in np.flatnonzero(which)]

    def _warnings(self, fit: _Fit, model: LinearModel) -> list[str]:
        centres, weights = self._problem.centres[self._images], self._stated.member_weights
        no_fix = self._positions.no_fix
        unchecked = fit.agrees & unchecked_positions(centres, weights, fit.agrees)
        return [
            *(NO_FIX.format(name) for k, name in enumerate(self._names) if no_fix is not None and no_fix[k]),
            *(BLIND.format(name) for name in self._blind),
            *warnings_of_all(
                self._problem.cameras, centres, self._stated, self._of_positions, fit.sigma_m, self._seed
            ),
            *(UNCHECKED.format(name) for name in self._named(unchecked)),
            *disagreement_warning(self._named(~fit.agrees), len(self._images)),
            *deviation_warning(model, fit.apart[fit.used], weights[fit.used], self._named(fit.used)),
        ]

    def _outcome(self, fit: _Fit, model: LinearModel) -> GpsOutcome:
        distances = np.linalg.norm(fit.apart, axis=1).tolist()
        judged, sigmas_m, intrinsics_sigmas = _sigmas_of_result(self._problem, model)
        return GpsOutcome(
            sigma_m=fit.sigma_m,
            accuracy_m=float(np.sqrt(np.mean(sigmas_m**2))),
            outliers=self._named(~fit.agrees),
            origin=self._positions.origin,
            geodetic=self._positions.geodetic,
            stated_sigma_m=self._stated.stated_sigma_m,
            residuals_m=dict(zip(self._of_positions, distances, strict=True)),
            offsets_m=dict(zip(self._of_positions, fit.apart, strict=True)),
            sigmas_m={self._names[image]: sigma for image, sigma in zip(judged, sigmas_m, strict=True)},
            warnings=self._warnings(fit, model),
            intrinsics_sigmas=intrinsics_sigmas,
            without_position=[self._names[image] for image in np.flatnonzero(~self._positions.known)],
        )


def _see_points(problem: Problem) -> BoolArray:
    """(C,) which cameras see a point, or one of their rigid frame does: what a solve places."""
    sees = observing_cameras(problem)
    if problem.rigs is None:
        return sees
    frames = problem.rigs.frame_of_camera
    return np.isin(frames, frames[sees])


def _fitted_similarity(centres: FloatArray, metres: FloatArray, weights: FloatArray) -> Similarity:
    """Similarity that brings `centres` (n, 3) nearest to `metres` (n, 3)."""
    try:
        return fit_similarity(centres, metres, weights.mean(axis=1))
    except InvalidArgument as error:
        raise InvalidArgument(f"gps: no positions tell where the model is: {error}") from error


def _sigmas_of_result(
    problem: Problem, model: LinearModel
) -> tuple[NDArray[np.int32], FloatArray, FloatArray | None]:
    """Images that see points, σ of their centres (n, 3) [m], and of intrinsics (G, k) unless many."""
    images, examples = np.flatnonzero(_see_points(problem)), an_image_of_each(problem)
    spread = images[np.linspace(0, len(images) - 1, min(len(images), _JUDGED)).astype(np.int32)]
    some = np.union1d(spread, examples) if len(examples) <= _JUDGED else spread
    judged: NDArray[np.int32] = some.astype(np.int32)
    covariances = model.covariance(cameras=judged).cameras * pixel_variance(model)
    intrinsics = None
    if len(examples) <= _JUDGED:
        of_examples = covariances[np.searchsorted(judged, examples)]
        intrinsics = intrinsics_sigmas_of(problem, model, of_examples)
    placed = np.isin(judged, images)
    sigmas_m = np.sqrt(np.diagonal(covariances[placed], axis1=1, axis2=2)[:, 3:6])
    return judged[placed], sigmas_m, intrinsics
