"""Focal lengths that the images of a model do not determine.

Where all cameras look in nearly the same direction on nearly flat ground, as those of a flight straight
down do, in any pattern and from any height, a longer focal length and cameras as much farther away project to
nearly the same pixels. Positions of the images, known accurately, tell which it is.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sfmcpp.errors import InvalidArgument
from sfmcpp.map import LocalProblem, Map
from sfmcpp.model.arrays import BoolArray, FloatArray, IndexArray
from sfmcpp.model.camera_models import PERSPECTIVE
from sfmcpp.sfm.adjustment import FINE, adjust_all, hold_of_few_images
from sfmcpp.sfm.cameras import Cameras
from sfmcpp.sfm.intrinsics_sigmas import sigmas_of_intrinsics
from sfmcpp.sfm.settings import IncrementalSettings

# The σ that residuals tell is several times too small: of such a focal length, a fifth may be wrong, and more
# than the focal length that a file tells.
_LEAST_SHARE = 0.05
# A guess is hardly worse than an estimate of which the half is σ.
_HALF = 0.5
_F, _K1 = PERSPECTIVE.index("f"), PERSPECTIVE.index("k1")


def hold_undetermined_focals(world: Map, cameras: Cameras, settings: IncrementalSettings) -> IndexArray:
    """Hold the focal lengths that the images do not determine at those that are known.

    What files or the user tell, and guesses where the estimate is no better, take the place of the estimates;
    the model is to be adjusted again then.

    Parameters
    ----------
    world : Map
        Adjusted.
    cameras : Cameras
        What is estimated of each.
    settings : IncrementalSettings
        How many images a camera needs; those with fewer stay as they are.

    Returns
    -------
    (k,) int32
        Numbers of these cameras.
    """
    found = _undetermined_by_images(world, cameras, settings)
    _hold(world, cameras, found)
    return np.array(list(found), dtype=np.int32)


def held_distortions(world: Map, cameras: Cameras) -> IndexArray:
    """(k,) numbers of cameras without distortion because what the images gave was that of no lens."""
    held = world.fixed_intrinsics[:, _K1] & ~cameras.fixed[:, _K1]
    return np.flatnonzero(held).astype(np.int32)


def settle_focals_by_images(world: Map, cameras: Cameras, settings: IncrementalSettings) -> list[str]:
    """Hold what the images of a finished model do not determine, and warn of all that is held.

    What was held stays: refined observations leave smaller residuals, not smaller systematic errors.
    """
    held = held_focals(world, cameras)
    found = _undetermined_by_images(world, cameras, settings)
    more = {camera: share for camera, share in found.items() if not held[camera]}
    if more and cameras.model_is_open:
        _hold(world, cameras, more)
        adjust_all(world, settings, **FINE)
    found |= {int(k): max(found.get(int(k), 0.0), _LEAST_SHARE) for k in np.flatnonzero(held)}
    warnings = _warnings(world, found, "the images do") + _moved(world, cameras, found)
    return warnings or _undetermined_distortions(world, cameras)


def settle_focals_by_positions(
    world: Map, cameras: Cameras, settings: IncrementalSettings, adjust: Callable[[], FloatArray | None]
) -> list[str]:
    """Free what was held if positions determine it, hold what nothing does, and warn of that.

    Parameters
    ----------
    world : Map
        It is adjusted.
    cameras : Cameras
        What is estimated of each.
    settings : IncrementalSettings
        How many images a camera needs.
    adjust : callable
        Adjusts the model with positions, as far as it is free, and tells σ (G, n) of its intrinsics.

    Returns
    -------
    list of str
        A sentence at most.
    """
    held = held_focals(world, cameras)
    alone = _shares_by_images(world, cameras, settings) if held.any() else {}
    world.fixed_intrinsics[held, _F] = False
    try:
        sigmas = adjust()
    except (InvalidArgument, KeyboardInterrupt):
        world.fixed_intrinsics[held, _F] = True
        raise
    shares = _shares(world.whole_problem(2), sigmas, settings)
    # Most of what frees it must come from the positions: that of the images was not enough.
    limits = {k: min(_LEAST_SHARE, _HALF * share) for k, share in alone.items() if held[k]}
    found = {
        k: max(share, _LEAST_SHARE) for k, share in shares.items() if share > limits.get(k, _LEAST_SHARE)
    }
    if found and cameras.model_is_open:
        _hold(world, cameras, found)
        adjust()
    return _warnings(world, found, "images and positions do") + _moved(world, cameras, found)


def held_focals(world: Map, cameras: Cameras) -> BoolArray:
    """(G,) of which cameras the focal length is held though nobody asked for that."""
    return np.asarray(world.fixed_intrinsics[:, _F] & ~cameras.fixed[:, _F])


def _shares(
    local: LocalProblem, sigmas: FloatArray | None, settings: IncrementalSettings
) -> dict[int, float]:
    """σ over focal length by the number of the camera, of those with enough images; nothing without σ."""
    if sigmas is None:
        return {}
    few = hold_of_few_images(local.problem, settings)
    shares = sigmas[:, _F] / local.problem.intrinsics[:, _F]
    return {int(local.cameras[row]): float(shares[row]) for row in np.flatnonzero(~few)}


def _shares_by_images(world: Map, cameras: Cameras, settings: IncrementalSettings) -> dict[int, float]:
    local = world.whole_problem(2)
    local.problem.fixed_intrinsics[:, _F] = cameras.fixed[local.cameras, _F]
    if local.problem.fixed_intrinsics[:, _F].all():
        return {}
    hold_of_few_images(local.problem, settings)
    return _shares(local, sigmas_of_intrinsics(local.problem), settings)


def _undetermined_by_images(world: Map, cameras: Cameras, settings: IncrementalSettings) -> dict[int, float]:
    shares = _shares_by_images(world, cameras, settings)
    return {camera: share for camera, share in shares.items() if share > _LEAST_SHARE}


def _hold(world: Map, cameras: Cameras, found: dict[int, float]) -> None:
    for camera, share in found.items():
        if not cameras.guessed[camera] or share > _HALF:
            world.intrinsics[camera] = cameras.intrinsics[camera]
        world.fixed_intrinsics[camera, _F] = True


def _moved(world: Map, cameras: Cameras, undetermined: dict[int, float]) -> list[str]:
    """Warn of the focal length farthest from the one that was told, where a named model let it go there."""
    if cameras.model_is_open:
        return []
    free = ~world.fixed_intrinsics[:, _F] & ~cameras.guessed
    free &= np.isin(np.arange(len(free)), world.image_cameras[world.registered])
    free[list(undetermined)] = False
    change = np.where(free, world.intrinsics[:, _F] / cameras.intrinsics[:, _F] - 1, 0.0)
    worst = int(np.argmax(np.abs(change)))
    if abs(change[worst]) <= _LEAST_SHARE:
        return []
    name = world.image_names[np.flatnonzero(world.registered & (world.image_cameras == worst))[0]]
    return [
        f"the focal length of the camera of {name} is estimated as {world.intrinsics[worst, _F]:.0f} px, "
        f"{change[worst]:+.0%} from the {cameras.intrinsics[worst, _F]:.0f} px that are told: camera model "
        f"{cameras.names[worst]}, as named, estimates it; --camera-model fixed holds it"
    ]


def _undetermined_distortions(world: Map, cameras: Cameras) -> list[str]:
    held = held_distortions(world, cameras)
    held = held[np.isin(held, world.image_cameras[world.registered])]
    if not len(held):
        return []
    name = world.image_names[np.flatnonzero(world.registered & (world.image_cameras == held[0]))[0]]
    return [
        f"the images do not determine the focal length (camera of {name}, estimated as "
        f"{world.intrinsics[held[0], _F]:.0f} px) beside the distortion, which was that of no lens and is "
        "taken as none: heights and depths may be wrong by a factor; give a calibrated camera (--camera "
        "K.txt)"
    ]


def _warnings(world: Map, found: dict[int, float], told_by: str) -> list[str]:
    if not found:
        return []
    worst = max(found, key=found.__getitem__)
    of = "the focal length" if len(found) == 1 else f"{len(found)} focal lengths"
    images = np.flatnonzero(world.registered & (world.image_cameras == worst))
    held = "held at" if world.fixed_intrinsics[worst, _F] else "estimated as"
    name = world.image_names[images[0]]
    return [
        f"{told_by} not determine {of} (σ {found[worst]:.0%}, camera of {name}, {held} "
        f"{world.intrinsics[worst, _F]:.0f} px): heights and depths are wrong by the same factor; give a "
        "calibrated camera (--camera K.txt) or accurate positions (--gps), or add oblique photos"
    ]
