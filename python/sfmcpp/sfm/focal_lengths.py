"""Focal lengths that the images of a model do not determine.

Where all cameras look in nearly the same direction on nearly flat ground, as those of one strip of a flight
do, a longer focal length and cameras as much farther away project to nearly the same pixels.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sfmcpp.map import Map
from sfmcpp.model.arrays import IndexArray
from sfmcpp.sfm.adjustment import hold_of_few_images
from sfmcpp.sfm.cameras import PERSPECTIVE, Cameras
from sfmcpp.sfm.intrinsics_sigmas import sigmas_of_intrinsics
from sfmcpp.sfm.settings import IncrementalSettings

# The σ that residuals tell is several times too small: of such a focal length, a fifth may be wrong, and more
# than the focal length that a file tells.
_LEAST_SHARE = 0.05
# A guess is hardly worse than an estimate of which the half is σ.
_HALF = 0.5
_F = PERSPECTIVE.index("f")


def undetermined_focals(world: Map, cameras: Cameras, settings: IncrementalSettings) -> dict[int, float]:
    """Find the cameras of a model whose focal length its images do not determine.

    Parameters
    ----------
    world : Map
        Adjusted. Whether its focal lengths are held does not matter.
    cameras : Cameras
        What is estimated of each.
    settings : IncrementalSettings
        How many images a camera needs; of those with fewer, nothing is said.

    Returns
    -------
    dict of int to float
        σ over focal length by the number of the camera.
    """
    local = world.whole_problem(2)
    local.problem.fixed_intrinsics[:, _F] = cameras.fixed[local.cameras, _F]
    if local.problem.fixed_intrinsics[:, _F].all():
        return {}
    few = hold_of_few_images(local.problem, settings)
    sigmas = sigmas_of_intrinsics(local.problem)
    if sigmas is None:
        return {}
    shares = sigmas[:, _F] / local.problem.intrinsics[:, _F]
    rows = np.flatnonzero((shares > _LEAST_SHARE) & ~few)
    return {int(local.cameras[row]): float(shares[row]) for row in rows}


def hold_undetermined_focals(world: Map, cameras: Cameras, settings: IncrementalSettings) -> IndexArray:
    """Hold the focal lengths that the images do not determine at those that are known.

    What files or the user tell, and guesses where the estimate is no better, take the place of the estimates;
    the model is to be adjusted again then.

    Returns
    -------
    (k,) int32
        Numbers of these cameras.
    """
    found = undetermined_focals(world, cameras, settings)
    for camera, share in found.items():
        if not cameras.guessed[camera] or share > _HALF:
            world.intrinsics[camera] = cameras.intrinsics[camera]
        world.fixed_intrinsics[camera, _F] = True
    return np.array(list(found), dtype=np.int32)


def undetermined_focal_warnings(
    models: Sequence[Map], cameras: Cameras, settings: IncrementalSettings
) -> list[str]:
    """Warn of focal lengths that the images do not determine, a sentence for each model that has some."""
    warnings = []
    for world in models:
        found = undetermined_focals(world, cameras, settings)
        if found:
            worst = max(found, key=found.__getitem__)
            warnings.append(_warning(world, worst, found[worst], len(found)))
    return warnings


def _warning(world: Map, camera: int, share: float, count: int) -> str:
    of = "the focal length" if count == 1 else f"{count} focal lengths"
    images = np.flatnonzero(world.registered & (world.image_cameras == camera))
    held = "held at" if world.fixed_intrinsics[camera, _F] else "estimated as"
    return (
        f"the images do not determine {of} (σ {share:.0%}, camera of {world.image_names[images[0]]}, {held} "
        f"{world.intrinsics[camera, _F]:.0f} px): heights and depths are wrong by about the same factor; "
        "give a calibrated camera (--camera K.txt), or add photos from other heights or directions"
    )
