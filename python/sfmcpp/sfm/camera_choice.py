"""Choice of the distortion model by the cost of the whole model; objections to a calibration that was given.

A model of too few parameters bends the scene, focal length and heights first; one of too many takes up noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from sfmcpp.doctor.calibration import calibration
from sfmcpp.doctor.case import Case
from sfmcpp.doctor.distortion import distortion
from sfmcpp.errors import InvalidArgument
from sfmcpp.geometry import agreeing_pairs, fit_similarity
from sfmcpp.map import Map
from sfmcpp.model import Problem
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.sensors.gps import LEAST_POSITIONS
from sfmcpp.sfm.adjustment import FINE, adjusted, impossible_focals
from sfmcpp.sfm.cameras import Cameras
from sfmcpp.sfm.intrinsics_sigmas import sigmas_of_intrinsics
from sfmcpp.sfm.positions import Positions
from sfmcpp.sfm.settings import IncrementalSettings


class _Step(NamedTuple):
    """Intrinsics that are freed together."""

    intrinsics: tuple[str, ...]
    worth: float  # they stay free if they lower the cost by this share,
    most_sigma: float  # and if they and the focal length are determined to this share of the focal length
    model: str | None  # name of the model then, if it gets another


# Each on top of what was worth it before. Noise alone lowers the cost of M observations by less than 1 / M
# for each intrinsic; other errors of a model lend as much as one percent to distortion and aspect ratio. To a
# principal point that is the centre they lend up to 0.002; one that is half a percent of the width off is
# worth 0.006 and more. Over flat ground seen from above it takes the focal length along, on a turntable the
# tilt of all cameras: where the images tell so little of it, its σ shows it (bench/sfm/README.md).
_STEPS = (
    _Step(("k2",), 0.015, np.inf, "radial"),
    _Step(("cx", "cy"), 0.004, 0.003, None),
    _Step(("aspect",), 0.015, 0.003, "opencv"),
)
# An estimated aspect ratio beyond this factor is that of no camera: their pixels are square.
_MOST_UNEVEN = 1.05
_FOCAL, _ASPECT = PERSPECTIVE.index("f"), PERSPECTIVE.index("aspect")
# So much farther from positions of the images, in the root mean square, is no chance with a dozen of them.
_BENT = 1.15


def choose_camera_model(
    world: Map,
    settings: IncrementalSettings,
    positions: Positions | None = None,
    simple: Sequence[int] | IndexArray = (),
) -> None:
    """Free more intrinsics of the cameras of a model, as long as that is worth it.

    Where positions of the images are known, they check it: intrinsics that bend the model away from them stay
    as they are, however much they lower the cost of the images.

    Parameters
    ----------
    world : Map
        Adjusted with ``"simple-radial"`` cameras, or those chosen before it was joined of parts; it is
        adjusted with those that are chosen, and they are named.
    settings : IncrementalSettings
        Scale of the loss, and how many images a camera needs.
    positions : Positions, optional
        Where the images were taken.
    simple : (k,) int
        Cameras that stay simple: more intrinsics make worse of a focal length that nothing determines.
    """
    name, best = "simple-radial", adjusted(world, settings, **FINE)
    apart = _position_rms(world.poses, positions, settings)
    for step in _STEPS:
        local = world.whole_problem(2)
        estimated = ~local.problem.fixed_intrinsics.all(axis=1) & ~np.isin(local.cameras, simple)
        if not estimated.any():
            break
        freed = local.problem.fixed_intrinsics.copy()
        for intrinsic in step.intrinsics:
            freed[estimated, PERSPECTIVE.index(intrinsic)] = False
        if np.array_equal(freed, local.problem.fixed_intrinsics):
            name = step.model or name
            continue
        local.problem.fixed_intrinsics[:] = freed
        cost = adjusted(world, settings, local, **FINE)
        poses = world.poses.copy()
        poses[local.images] = local.problem.cameras
        moved = _position_rms(poses, positions, settings)
        is_worth_it = cost < (1 - step.worth) * best and moved <= _BENT * apart
        if is_worth_it and _is_determined(local.problem, estimated, step):
            world.take(local)
            world.fixed_intrinsics[local.cameras] = freed
            name, best, apart = step.model or name, cost, moved
    for camera in np.setdiff1d(np.flatnonzero(~world.fixed_intrinsics.all(axis=1)), simple):
        world.camera_names[camera] = name.upper().replace("-", "_")


def _is_determined(problem: Problem, cameras: BoolArray, step: _Step) -> bool:
    """Whether the images tell what a step has freed of `cameras` (G,), and the focal length beside it."""
    if np.isinf(step.most_sigma):
        return True
    sigmas = sigmas_of_intrinsics(problem)
    if sigmas is None:
        return False
    focals, sigmas = problem.intrinsics[cameras, _FOCAL], sigmas[cameras]
    shares = [sigmas[:, PERSPECTIVE.index(name)] / focals for name in ("f", "cx", "cy")]
    return bool(np.max([*shares, sigmas[:, _ASPECT]]) <= step.most_sigma)


def _position_rms(poses: FloatArray, positions: Positions | None, settings: IncrementalSettings) -> float:
    """Root mean squared distance of the images from their positions, where they agree; 0 if unknown [m]."""
    if positions is None:
        return 0.0
    known = np.isfinite(poses[:, 0, 0]) & np.isfinite(positions.metres[:, 0])
    if np.count_nonzero(known) < LEAST_POSITIONS:
        return 0.0
    centres, metres = poses[known, :, 3], positions.metres[known]
    good = agreeing_pairs(centres, metres, seed=settings.seed)
    try:
        place = fit_similarity(centres[good], metres[good])
    except InvalidArgument:  # all at one place, or on a line: they tell nothing of how a model bends
        return 0.0
    return float(np.sqrt(((place.apply(centres) - metres)[good] ** 2).sum(axis=1).mean()))


def camera_warnings(models: Sequence[Map], cameras: Cameras) -> list[str]:
    """Warn of given cameras that the images contradict, and of estimated ones that no camera can be.

    Where focal lengths were given to stay, the doctor tries other calibrations.

    Parameters
    ----------
    models : sequence of Map
        Adjusted.
    cameras : Cameras
        What was given.

    Returns
    -------
    list of str
        A sentence for each contradiction, and for each model with pixels that are not square or a focal
        length that no lens has.
    """
    if not cameras.fixed[:, PERSPECTIVE.index("f")].all():
        return _uneven_pixels(models) + _impossible_focals(models)
    warnings = []
    for world in models:
        case = Case(world.whole_problem(2).problem, [], None)
        for examine in (distortion, calibration):
            warnings += [f"the camera as given: {f.what}" for f in examine(case) if f.severity == "warning"]
    return warnings


def _uneven_pixels(models: Sequence[Map]) -> list[str]:
    """The estimated camera of each model whose pixels are farthest from square, as those of cameras are."""
    warnings = []
    for world in models:
        used = np.unique(world.image_cameras[world.registered])
        aspects = np.where(world.fixed_intrinsics[used, _ASPECT], 1.0, world.intrinsics[used, _ASPECT])
        worst = int(np.argmax(np.abs(np.log(np.maximum(aspects, 1e-6)))))
        if not 1 / _MOST_UNEVEN <= aspects[worst] <= _MOST_UNEVEN:
            warnings.append(
                f"fy / fx of {_camera_by_image(world, used[worst])} is estimated as {aspects[worst]:.2f}, "
                "but pixels of cameras are square: the images leave it open or were resized unevenly, or the "
                "model is wrong"
            )
    return warnings


def _impossible_focals(models: Sequence[Map]) -> list[str]:
    """The first estimated focal length of each model that no lens has."""
    warnings = []
    for world in models:
        used = np.unique(world.image_cameras[world.registered])
        focals, sides = world.intrinsics[used, 0], world.camera_sizes[used].max(axis=1)
        for k in np.flatnonzero(impossible_focals(focals, sides))[:1]:
            warnings.append(
                f"the focal length of {_camera_by_image(world, used[k])} is estimated as "
                f"{focals[k]:.0f} px, in images of {sides[k]:.0f} px: no lens has that, the model is wrong"
            )
    return warnings


def _camera_by_image(world: Map, camera: int) -> str:
    """A camera in words, by its first image with a pose."""
    first = np.flatnonzero(world.registered & (world.image_cameras == camera))[0]
    return f"the camera of {world.image_names[first]}"
