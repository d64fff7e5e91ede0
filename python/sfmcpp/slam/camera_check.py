"""Whether the images of a finished map contradict the focal length and the distortion that were given.

A wrong focal length or a distortion that is not given bends the map in silence: poses and points take up
most of it. Freed in an adjustment of the whole map, each tells its value, and how well the motion determines
it: along a straight road hardly at all, with turns within a few percent.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sfmcpp.ba import LinearModel, SolveOptions, adjust
from sfmcpp.doctor.trial import RIDGE, as_perspective, moved_at_border, radii_px
from sfmcpp.errors import InvalidArgument
from sfmcpp.model import Problem
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.slam.mapping import ROBUST_LOSS
from sfmcpp.slam.settings import SlamSettings
from sfmcpp.slam.world_map import WorldMap

# So many standard deviations contradict; right cameras differed by up to 4.3 in 28 runs over drives for
# tuning, their parts and changes, because errors of tracks last for several images (bench/wrong_cameras.py).
_SIGMAS = 5.0
# The cost must fall by this, too: far from a value that the images hardly tell its σ by the linear model is
# too small. The likelihood is then e² times as large.
_LEAST_FALL = 2.0
# Less than this part of the focal length, or of the radius at the border of the image, bends no map notably.
_LEAST = 0.02
# A map of fewer keyframes tells nothing.
_FEWEST_KEYFRAMES = 5
_MOST_STEPS, _TOLERANCE = 50, 1e-6


@dataclass(frozen=True)
class FreedIntrinsic:
    """An intrinsic of the camera, all others held, as the images of a map prefer it.

    Attributes
    ----------
    given, preferred, sigma : float
        Its value before and after, and its standard deviation by the linear model; f in pixels.
    moved : float
        Part by which the change moves a pixel at the border away from the principal point.
    fall : float
        By how much the cost of the images is below that with all intrinsics held.
    """

    given: float
    preferred: float
    sigma: float
    moved: float
    fall: float

    @property
    def contradicts(self) -> bool:
        """Whether the images contradict the value that was given."""
        is_far = abs(self.preferred - self.given) > _SIGMAS * self.sigma
        return is_far and self.fall > _LEAST_FALL and abs(self.moved) > _LEAST


def freed_intrinsics(world: WorldMap, settings: SlamSettings) -> dict[str, FreedIntrinsic]:
    """Free the focal length and the distortion k1 of the camera in turn, with all keyframes and points.

    Sensors are left out: they may be at fault themselves.

    Parameters
    ----------
    world : WorldMap
        The map at the end of a run; it is not changed.
    settings : SlamSettings
        The fewest views of a point.

    Returns
    -------
    dict of str to FreedIntrinsic
        By ``"f"`` and ``"k1"``; empty where the map is too small.
    """
    problem = world.whole_problem(settings.min_views).problem
    if problem.num_cameras < _FEWEST_KEYFRAMES or not problem.num_observations:
        return {}
    try:
        held = _with_free(problem)
        cost = _adjusted(held)
        return {name: _freed(held, name, cost) for name in ("f", "k1")}
    except InvalidArgument:  # as where a map has collapsed
        return {}


def warn_of_camera(world: WorldMap | None, settings: SlamSettings) -> list[str]:
    """Warn if the images contradict the camera; one warning, or none.

    What explains the images better is named: a wrong focal length looks like a distortion, and the reverse.
    """
    freed = {} if world is None else freed_intrinsics(world, settings)
    doubtful = {name: one for name, one in freed.items() if one.contradicts}
    if not doubtful:
        return []
    name = max(doubtful, key=lambda name: doubtful[name].fall)
    return [f"the images contradict the camera that is given: {_TEXTS[name](doubtful[name])}"]


def _freed(problem: Problem, name: str, held: float) -> FreedIntrinsic:
    trial, column = _with_free(problem, name), PERSPECTIVE.index(name)
    given = float(trial.intrinsics[0, column])
    focal, radius = trial.intrinsics[0, :1].copy(), radii_px(trial).max(keepdims=True)
    fall = held - _adjusted(trial)
    model = LinearModel(trial, [], _robust(gauge="fixed"), RIDGE)
    place = model.parameter_names.index(name)
    variance = float(model.covariance(cameras=[0]).cameras[0, place, place])
    preferred = float(trial.intrinsics[0, column])
    moved = (preferred - given) * float(moved_at_border(column, focal, radius)[0])
    return FreedIntrinsic(given, preferred, max(variance, 0.0) ** 0.5, moved, fall)


def _adjusted(problem: Problem) -> float:
    """Adjust, and return the cost."""
    options = _robust(max_iterations=_MOST_STEPS, function_tolerance=_TOLERANCE)
    return adjust(problem, [], options).require_uninterrupted().final_cost


def _robust(**more: Any) -> SolveOptions:
    loss, scale_px = ROBUST_LOSS
    return SolveOptions(loss=loss, loss_scale_px=scale_px, **more)


def _with_free(problem: Problem, *names: str) -> Problem:
    """A copy in which all images share one camera, of which these intrinsics alone are free."""
    problem = as_perspective(problem.copy())
    fixed = np.ones((1, len(PERSPECTIVE)), dtype=np.bool_)
    fixed[0, [PERSPECTIVE.index(name) for name in names]] = False
    return replace(
        problem,
        intrinsics=problem.intrinsics[:1].copy(),
        fixed_intrinsics=fixed,
        intrinsics_index=np.zeros_like(problem.intrinsics_index),
    )


def _told_focal(one: FreedIntrinsic) -> str:
    longer = "longer" if one.moved > 0 else "shorter"
    return (
        f"they prefer a focal length of {one.preferred:,.5g} ± {one.sigma:.2g} px, {abs(one.moved):.0%} "
        f"{longer} than {one.given:,.5g} px; check the calibration, and the image size that it belongs to"
    )


def _told_distortion(one: FreedIntrinsic) -> str:
    given = f"{one.given:.3g}" if one.given else "none"
    return (
        f"they prefer a distortion k1 of {one.preferred:.2g} ± {one.sigma:.1g} to {given}: it moves pixels "
        f"at the border by {abs(one.moved):.0%} of their distance from the centre; calibrate the lens, or "
        "take undistorted images"
    )


_TEXTS = {"f": _told_focal, "k1": _told_distortion}
